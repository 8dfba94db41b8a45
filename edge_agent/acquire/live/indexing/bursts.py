"""Detects bursts: samples that were held back on the way and arrive at once after a pause."""

import collections

PAUSE_S = 0.25
"""Pause that a burst may follow, at least [s]. Source: judgement; no study is recorded."""

SPACINGS = 8
"""Pause that a burst may follow, at least, in spacings of what arrives at once [1]. Source:
judgement; no study is recorded."""

MADE_UP, WITHIN = 0.5, 0.25
"""A burst makes up for this part of a pause within this part of its length [1]. Source:
judgement; no study is recorded."""


class Bursts:
    """Recognises bursts by arrivals alone.

    Examples
    --------
    >>> bursts, at = Bursts(100.0), [*range(0, 500, 10), *range(1500, 1600)]
    >>> sum(bursts.note(1_000_000 * ms, 1) for ms in at)
    1
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._last_ns: int | None = None
        self._since_ns = self._within_ns = 0
        self._owed = 0.0

    def note(self, arrival_ns: int, count: int) -> bool:
        """Take up that `count` samples came; whether a burst is complete with them."""
        pause_s = 0.0 if self._last_ns is None else (arrival_ns - self._last_ns) / 1e9
        self._last_ns = arrival_ns
        if pause_s > max(PAUSE_S, SPACINGS * count / self._rate_hz):
            self._owed = MADE_UP * pause_s * self._rate_hz
            self._since_ns, self._within_ns = arrival_ns, round(WITHIN * pause_s * 1e9)
        if not self._owed:
            return False
        if arrival_ns - self._since_ns > self._within_ns:
            self._owed = 0.0
            return False
        self._owed -= count
        if self._owed > 0:
            return False
        self._owed = 0.0
        return True


class Backlog:
    """Whether messages queued before the agent listened have been read.

    Its samples come all at once: until then arrivals say nothing of when they were taken, and
    nothing tells a queue that is drained from a device that is faster than its nominal rate.

    Examples
    --------
    >>> backlog, held = Backlog(100.0), []
    >>> for ms in [*range(0, 100), *range(100, 1500, 10)]:
    ...     backlog.note(1_000_000 * ms, 1)
    ...     held.append(backlog.lasts)
    >>> held.index(False)
    148
    """

    SPAN_S, FEWEST, FASTER = 0.5, 3, 1.5
    """Time [s] and messages [1] over which arrivals are counted, and their rate over the
    nominal one [1] beyond which a queue is read. Source: judgement; no study is recorded."""

    def __init__(self, rate_hz: float) -> None:
        self.lasts = True
        self._rate_hz = rate_hz
        self._recent: collections.deque[tuple[int, int]] = collections.deque()
        self._count = 0

    def note(self, arrival_ns: int, count: int) -> None:
        """Take up that `count` samples came."""
        if not self.lasts:
            return
        if self._recent and arrival_ns < self._recent[-1][0]:
            self._recent.clear()  # the clock was set back: spans do not compare
        self._count += count
        self._recent.append((arrival_ns, self._count))
        span_ns = round(self.SPAN_S * 1e9)
        while len(self._recent) > self.FEWEST and arrival_ns - self._recent[1][0] >= span_ns:
            self._recent.popleft()
        since_ns, before = self._recent[0]
        passed_ns = arrival_ns - since_ns
        if passed_ns >= span_ns and len(self._recent) >= self.FEWEST:
            faster = (self._count - before) * 1e9 / passed_ns > self.FASTER * self._rate_hz
            self.lasts = faster
