"""A diagnosis in slow time: the twin's history and what was read beside it."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from slowtime.discrepancy import slow
from slowtime.discrepancy.diagnose import Cancelled
from slowtime_services.diagnose.slow import slow_document, write_slow_results

from .task import HISTORY, Task

COVARIATE = "covariate "
"""Before the name of a covariate in the file of a history."""

_NAMES = {"T0": "period"}
_UNITS = {"c": "°C", "k": "K", "kg": "kg", "t": "t", "n": "N", "percent": "%"}
"""Of a covariate, by the end of its name."""


def diagnose_history(
    task: Task,
    folder: Path,
    progress: Callable[[str, float], None],
    stop: threading.Event,
) -> None:
    """Do it, and write the files.

    Raises
    ------
    ValueError
        Where there are too few epochs; the text says what to do.
    """

    def tell(stage: str, share: float) -> None:
        if stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        progress(stage, share)

    began = time.monotonic()
    unit = _NAMES.get(task.slow_time_unit, task.slow_time_unit)
    with np.load(folder / HISTORY) as kept:
        covariates = [
            slow.Covariate(
                name.removeprefix(COVARIATE), kept[name], _UNITS.get(name.split("_")[-1], "")
            )
            for name in kept.files
            if name.startswith(COVARIATE)
        ]
        report = slow.diagnose_history(
            kept["slow_time"],
            kept["value"],
            kept["sd"],
            covariates,
            quantity=task.quantity,
            time_unit=unit,
            progress=tell,
        )
    document = slow_document(
        report,
        of=f"{task.site}.{task.asset}",
        quantity=task.quantity,
        time_unit=unit,
        seconds=time.monotonic() - began,
    )
    write_slow_results(folder, report, document)
