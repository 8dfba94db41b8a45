"""Arrivals of numbered samples → the highest number that a sample could have by now."""

ANCHOR_S = 10.0
"""Least delays are taken over this long, and over the time as long before it."""

SLACK_S = 0.1
"""What arrivals of one device differ by at least, on any network and any machine."""

DRIFT = 0.02
"""A nominal rate is within 2 % of the true one, or is another rate."""


class Delays:
    """Bounds numbers by arrivals, since no sample arrives before it was taken.

    Parameters
    ----------
    rate_hz
        Nominal samples per second.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = 1e9 / rate_hz
        self._anchors: list[tuple[float, int]] = []
        """Least delay [ns] and its arrival, of the time before and of now."""
        self._since_ns = 0

    def note(self, next_index: int, arrival_ns: int) -> None:
        """Take up that all samples before `next_index` had come at `arrival_ns`."""
        delay = arrival_ns - next_index * self._period_ns
        if not self._anchors or arrival_ns - self._since_ns > ANCHOR_S * 1e9:
            self._anchors = [*self._anchors[-1:], (delay, arrival_ns)]
            self._since_ns = arrival_ns
        elif delay < self._anchors[-1][0]:
            self._anchors[-1] = delay, arrival_ns

    def index_at(self, arrival_ns: int) -> float:
        """Give the number of the next sample, if what comes at `arrival_ns` is not delayed."""
        if not self._anchors:
            return 0.0
        delay, _ = min(self._anchors)
        return (arrival_ns - delay) / self._period_ns

    def is_ahead(self, next_index: int, arrival_ns: int) -> bool:
        """Whether samples up to `next_index` cannot have been taken at `arrival_ns`."""
        if not self._anchors:
            return False
        _, when_ns = min(self._anchors)
        slack_ns = SLACK_S * 1e9 + DRIFT * max(0, arrival_ns - when_ns)
        return next_index > self.index_at(arrival_ns) + 2 + slack_ns / self._period_ns

    def lag_s(self, next_index: int, arrival_ns: int) -> float:
        """By how much an arrival is later than the least delayed ones [s]."""
        return (self.index_at(arrival_ns) - next_index) * self._period_ns / 1e9
