"""The thread of one output: reads what is new, sends it, keeps the position."""

import logging
import threading
from collections.abc import Iterator

from slowtime_services.client import AnswerError, UnreachableError

from .batch import NotSentError, Output
from .history_reader import Found, HistoryReader
from .positions import Positions

logger = logging.getLogger(__name__)


class OutputWorker:
    """Sends to one receiver until it is stopped, whatever fails meanwhile.

    Parameters
    ----------
    every_s
        Between two looks for what is new [s].
    backoff_s, max_backoff_s
        Wait after a failure [s], doubled with each further one up to the longest.
    """

    def __init__(
        self,
        name: str,
        output: Output,
        reader: HistoryReader,
        positions: Positions,
        *,
        every_s: float,
        backoff_s: float,
        max_backoff_s: float,
    ) -> None:
        self.name = name
        self._output, self._reader, self._positions = output, reader, positions
        self._every_s, self._backoff_s, self._max_s = every_s, backoff_s, max_backoff_s
        self._stop = threading.Event()
        self._failures, self._said = 0, ""
        # A daemon: a receiver that hangs keeps no process from ending.
        self._thread = threading.Thread(target=self._run, name=f"output-{name}", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Begin nothing more, and wait for what is being sent [s]."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        is_started = False
        while not self._stop.is_set():
            try:
                if not is_started:
                    self._output.start()
                    is_started = True
                    self._reader.forget()
                self._turn()
                self._succeeded()
                wait_s = self._every_s
            except NotSentError as error:
                is_started = False
                self._close()
                wait_s = max(self._failed(str(error), error.is_refused), error.wait_s)
            except (AnswerError, UnreachableError) as error:
                wait_s = self._failed(str(error), False)
            except Exception as error:  # a fault of ours costs this attempt and no other output
                why = f"A fault of this process: {type(error).__name__}."
                if self._said != why:
                    logger.exception("The output %s failed.", self.name)
                is_started = False
                self._close()
                wait_s = self._failed(why, False)
            self._stop.wait(wait_s)
        self._close()

    def _close(self) -> None:
        try:
            self._output.close()
        except Exception:  # it is made anew, or ended, in any case
            logger.exception("The output %s could not be closed.", self.name)

    def _turn(self) -> None:
        found: Iterator[Found] = self._reader.read()
        for one in found:
            self._output.send(one.batch)
            self._positions.move(one.batch.twin.id, one.position)
            if self._failures:
                self._succeeded()
            if self._stop.is_set():
                return

    def _succeeded(self) -> None:
        if self._failures:
            logger.info("The output %s sends again.", self.name)
        self._failures, self._said = 0, ""

    def _failed(self, why: str, is_refused: bool) -> float:
        """Log a failure once; return how long to wait [s]."""
        self._failures += 1
        if why != self._said:
            log = logger.error if is_refused else logger.warning
            log("The output %s could not send. %s Trying again.", self.name, why)
            self._said = why
        if is_refused:
            return self._max_s
        # A float can be doubled a thousand times at most.
        return min(self._backoff_s * 2.0 ** min(self._failures - 1, 60), self._max_s)
