"""The process that sends the histories of a twin server to receivers."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

from slowtime_services.client import Client
from slowtime_services.operating_system import lock_file
from slowtime_services.shutdown import ended_by_signals

from .batch import NotSentError
from .history_reader import HistoryReader
from .positions import Positions, WrongPositionsError
from .receivers import make_output
from .secret_files import secret_of
from .settings import OutputsSettings
from .worker import OutputWorker

logger = logging.getLogger(__name__)

ENDING_S = 5.0
"""How long what is being sent is waited for when the process ends [s]."""


class OutputsInUseError(OSError):
    """Another process sends to the same outputs already."""


def run(
    settings: OutputsSettings,
    *,
    stop: threading.Event | None = None,
    ready: Callable[[], None] | None = None,
) -> int:
    """Send until `stop` is set, or until SIGINT or SIGTERM.

    Returns
    -------
    0 after a clean end, 2 where settings or files are wrong: the log says what to do.
    """
    with ended_by_signals(stop) as ending:
        try:
            workers = _workers(settings)
            locked = _locked(settings.folder)
        except (NotSentError, WrongPositionsError, OutputsInUseError, OSError) as error:
            logger.error("%s", error)
            return 2
        with locked:
            for worker in workers:
                worker.start()
            logger.info("%d outputs are sent from %s.", len(workers), settings.server)
            if ready is not None:
                ready()
            ending.wait()
            for worker in workers:
                worker.stop(ENDING_S)
    return 0


def _workers(settings: OutputsSettings) -> list[OutputWorker]:
    token = None if settings.token_file is None else secret_of(settings.token_file)
    made = []
    for name, one in settings.outputs.items():
        output = make_output(name, one)
        client = Client(settings.server, token=token, ca=settings.ca)
        positions = Positions(settings.folder / f"{name}.json")
        reader = HistoryReader(
            client,
            positions,
            one.takes,
            from_beginning=one.begin == "first",
            is_archive=output.is_archive,
        )
        made.append(
            OutputWorker(
                name,
                output,
                reader,
                positions,
                every_s=one.every_s,
                backoff_s=one.backoff_s,
                max_backoff_s=one.max_backoff_s,
            )
        )
    return made


def _locked(folder: Path) -> IO[bytes]:
    """Keep other processes from sending from the same positions."""
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / "lock").open("wb")
    try:
        lock_file(file.fileno(), wait=False)
    except OSError as error:
        file.close()
        raise OutputsInUseError(
            f"Another process sends from {folder}. End it, or give another folder."
        ) from error
    return file
