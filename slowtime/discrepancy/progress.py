"""How far a diagnosis has come, in; whether to go on, out."""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

Progress = Callable[[str, float], None]


@runtime_checkable
class Stop(Protocol):
    """What tells that somebody wants it to end, such as `threading.Event`."""

    def is_set(self) -> bool:
        """Whether to end."""
        ...


class Cancelled(Exception):
    """Somebody asked the diagnosis to stop."""


@dataclasses.dataclass(slots=True, eq=False)
class Monitor:
    """Tells how far it has come, and stops where asked to."""

    progress: Progress | None = None
    stop: Stop | None = None
    late: Callable[[], bool] | None = None
    over: Callable[[], bool] | None = None
    share_done: float = 0.0

    def __call__(self, stage: str, share: float) -> None:
        """Tell the stage in words and the share done; raise `Cancelled` where asked to end."""
        if self.stop is not None and self.stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        self.share_done = max(self.share_done, share)
        if self.progress is not None:
            self.progress(stage, self.share_done)

    @property
    def is_late(self) -> bool:
        """Whether only the likeliest should still be tried."""
        return self.late is not None and self.late()

    @property
    def is_over(self) -> bool:
        """Whether nothing more should be tried at all."""
        return self.is_late if self.over is None else self.over()
