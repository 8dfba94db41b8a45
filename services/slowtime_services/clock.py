"""Clocks: of the system, and one that is set by hand."""

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """Anything that returns the time and can wait."""

    def now_ns(self) -> int:
        """Now, in nanoseconds since 1970-01-01 UTC."""
        ...

    def sleep(self, seconds: float) -> None:
        """Return once `seconds` have passed on this clock."""
        ...

    def elapsed_ns(self) -> int:
        """Return the time since some instant, which no setting of the clock changes [ns]."""
        ...


class SystemClock:
    """The machine's clock."""

    def now_ns(self) -> int:
        """Now, in nanoseconds since 1970-01-01 UTC."""
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        """Block the calling thread for `seconds`."""
        time.sleep(max(seconds, 0.0))

    def elapsed_ns(self) -> int:
        """Return the time of the system's monotonic clock [ns]."""
        return time.monotonic_ns()


class HandClock:
    """A clock that moves only when it is set or slept on: for tests and for replay."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns, self._elapsed_ns = start_ns, 0

    def now_ns(self) -> int:
        """Time that was set."""
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        """Move the hand forward by `seconds`, at once."""
        self._now_ns += round(max(seconds, 0.0) * 1e9)
        self._elapsed_ns += round(max(seconds, 0.0) * 1e9)

    def elapsed_ns(self) -> int:
        """Return the time that was slept [ns]; setting the clock does not change it."""
        return self._elapsed_ns

    def set_ns(self, now_ns: int) -> None:
        """Set the time to `now_ns`, forwards or backwards."""
        self._now_ns = now_ns
