"""Progress of a diagnosis, its time limits, and its cancellation."""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from .workers import is_helping

Progress = Callable[[str, float], None]


@runtime_checkable
class Stop(Protocol):
    """A request to end, such as `threading.Event`."""

    def is_set(self) -> bool:
        """Whether the end was requested."""
        ...


class Cancelled(Exception):
    """The diagnosis was stopped on request."""


@dataclasses.dataclass(slots=True, eq=False)
class Monitor:
    """Reports progress and checks the time limits of a diagnosis.

    Parameters
    ----------
    late
        Whether only the likeliest candidates should still be tried.
    over
        Whether nothing more should be tried at all; as `late` where not given.
    so_far
        What is likely missing by now, in words; told with each stage from then on.
    """

    progress: Progress | None = None
    stop: Stop | None = None
    late: Callable[[], bool] | None = None
    over: Callable[[], bool] | None = None
    enough: Stop | None = None
    share_done: float = 0.0
    so_far: str = ""
    notes: list[str] = dataclasses.field(default_factory=list)

    def note(self, told: str) -> None:
        """Keep a note for the reader of the diagnosis, once."""
        if told not in self.notes:
            self.notes.append(told)

    def __call__(self, stage: str, share: float) -> None:
        """Report a stage.

        A smaller share than before is not reported. Raises `Cancelled` where the end was
        requested.
        """
        if self.stop is not None and self.stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        self.share_done = max(self.share_done, share)
        if self.progress is not None and not is_helping():
            told = f"{stage} (so far: {self.so_far})" if self.so_far else stage
            self.progress(told, self.share_done)

    @property
    def is_ended(self) -> bool:
        """Whether an answer is wanted now."""
        return self.enough is not None and self.enough.is_set()

    @property
    def is_late(self) -> bool:
        """Whether only the likeliest candidates should still be tried."""
        return self.is_ended or (self.late is not None and self.late())

    @property
    def is_over(self) -> bool:
        """Whether nothing more should be tried at all."""
        return self.is_ended or (self.is_late if self.over is None else self.over())
