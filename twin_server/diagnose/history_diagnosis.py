"""A diagnosis in slow time: the history of the twin and its covariates."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np

from slowtime.discrepancy.progress import Cancelled
from slowtime_services.diagnose.history_document import (
    diagnose_with_document,
    write_history_results,
)
from slowtime_services.diagnose.history_table import Quantity, TabulatedHistory, covariate

from .task import HISTORY, Task

COVARIATE = "covariate "
"""Before the name of a covariate in the file of a history."""

_NAMES = {"T0": "period"}


def diagnose_history(
    task: Task,
    folder: Path,
    progress: Callable[[str, float], None],
    stop: threading.Event,
) -> None:
    """Do it, and write the files.

    Parameters
    ----------
    task
        The task of this process.
    folder
        Folder that holds the history, and receives the results.
    progress
        Called with the stage in words and the share done, from 0 to 1.
    stop
        Set to end early.

    Raises
    ------
    ValueError
        Where there are too few epochs; the text says what to do.
    """

    def tell(stage: str, share: float) -> None:
        if stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        progress(stage, share)

    history = read_task_history(
        folder,
        of=f"{task.site}.{task.asset}",
        quantity=task.quantity,
        slow_time_unit=task.slow_time_unit,
    )
    report, document = diagnose_with_document(history, progress=tell)
    write_history_results(folder, report, document)


def read_task_history(
    folder: Path, *, of: str, quantity: Quantity, slow_time_unit: str
) -> TabulatedHistory:
    """Read the history that was left in a folder.

    Parameters
    ----------
    folder
        Folder of the task.
    of
        SITE.ASSET of the twin.
    quantity
        Quantity of the history.
    slow_time_unit
        Unit of its slow times.

    Returns
    -------
    Slow times, values, standard deviations and covariates.
    """
    with np.load(folder / HISTORY) as kept:
        return TabulatedHistory(
            of=of,
            time=kept["slow_time"],
            value=kept["value"],
            sd=kept["sd"],
            covariates=tuple(
                covariate(name.removeprefix(COVARIATE), kept[name])
                for name in kept.files
                if name.startswith(COVARIATE)
            ),
            quantity=quantity,
            time_unit=_NAMES.get(slow_time_unit, slow_time_unit),
        )
