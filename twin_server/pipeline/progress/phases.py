"""What the thread of the pipeline does now, and how often it has finished something."""

import contextlib
import enum
from collections.abc import Iterator


class Phase(enum.Enum):
    """What the thread of the pipeline does."""

    IDLE = "waits for messages"
    STEP = "works on messages"
    STORE = "waits for the database or serves a request"


class Progress:
    """Counts what is finished; one thread writes, others read."""

    def __init__(self) -> None:
        self.phase, self.finished = Phase.IDLE, 0

    def advance(self) -> None:
        """Note that something is finished: a part of a batch, of a rewrite, of a statement."""
        self.finished += 1

    @contextlib.contextmanager
    def doing(self, phase: Phase) -> Iterator[None]:
        """Note what is done meanwhile."""
        before, self.phase = self.phase, phase
        try:
            yield
        finally:
            self.phase = before
            self.finished += 1
