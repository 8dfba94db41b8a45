"""Logs a failure of the database once, and again at intervals while it lasts."""

import logging
import time
from typing import NamedTuple

logger = logging.getLogger(__name__)

REPEATED_S = 60.0
"""How often a failure that lasts is logged again [s]; batches may fail ten times a second."""

TOLD_S = 2.0
"""Shortest interruption that twins get an event of [s]; a busy disk makes shorter ones."""


class Interruption(NamedTuple):
    """A time in which the database took nothing: its begin (monotonic) and duration [s]."""

    began_s: float
    took_s: float


class FailureLog:
    """Failures of batches that are tried again as they are."""

    def __init__(self) -> None:
        self._text, self._said_s, self._count = "", 0.0, 0
        self._began_s = 0.0
        self.over: Interruption | None = None
        """An interruption that is over and not told yet."""

    def say(self, text: str) -> None:
        """Log a failure that is another one than the last, or that has lasted for long."""
        now_s = time.monotonic()
        self._count += 1
        if not self._text:
            self._began_s = now_s
        if text != self._text or now_s - self._said_s >= REPEATED_S:
            logger.error(
                "A batch failed, %d since this was last logged, and nothing of it is "
                "acknowledged: %s", self._count, text,
            )  # fmt: skip
            self._text, self._said_s, self._count = text, now_s, 0

    def clear(self) -> None:
        """Log the next failure at once, because a batch has succeeded."""
        if self._text:
            logger.warning("Batches are stored again.")
            took_s = time.monotonic() - self._began_s
            if took_s >= TOLD_S:
                self.over = Interruption(self._began_s, took_s)
        self._text, self._count = "", 0
