"""Detects that a device has changed its sampling rate for good."""

import statistics

WINDOW_S = 5.0
"""Length of a window over which the rate is measured [s]. Source: judgement, arrivals that
jitter by 0.05 s tell the rate to 1 to 2 %; no study is recorded."""

IN_A_ROW = 3
"""Windows in a row that must agree on another rate [1]. Source: judgement; no study is
recorded."""

ALIKE = 0.02
"""Relative difference within which windows agree with each other [1]. Source: what
jitter leaves uncertain, see `WINDOW_S`; judgement, no study is recorded."""

DIGITS = 3
"""Significant digits of the rate that is given [1]. Source: judgement; no study is
recorded."""


class RateWatch:
    """Compares the rate of windows with the nominal one.

    Parameters
    ----------
    tolerance
        Relative difference that an inexact clock explains.
    """

    def __init__(self, rate_hz: float, tolerance: float) -> None:
        self._rate_hz, self._tolerance = rate_hz, tolerance
        self._begin: tuple[int, int] | None = None
        self._others: list[float] = []

    def note(self, next_index: int, time_ns: int) -> float | None:
        """Take up how far the stream was; give another rate [Hz] where it has changed."""
        if self._begin is None:
            self._begin = next_index, time_ns
            return None
        index, since_ns = self._begin
        seconds = (time_ns - since_ns) / 1e9
        if seconds < WINDOW_S or next_index - index < 2 * WINDOW_S:
            return None
        self._begin = next_index, time_ns
        rate_hz = (next_index - index) / seconds
        if abs(rate_hz / self._rate_hz - 1) <= self._tolerance:
            self._others.clear()
            return None
        self._others = [*self._others, rate_hz][-IN_A_ROW:]
        middle = statistics.median(self._others)
        if len(self._others) < IN_A_ROW or any(
            abs(other / middle - 1) > ALIKE for other in self._others
        ):
            return None
        return rounded(middle)

    def interrupt(self) -> None:
        """Begin a new window, because the rate across a gap or restart is unknown."""
        self._begin = None


def rounded(rate_hz: float) -> float:
    """Return the rate that a device would be set to.

    Examples
    --------
    >>> rounded(124.97), rounded(499.2)
    (125.0, 499.0)
    """
    return float(f"{rate_hz:.{DIGITS}g}")
