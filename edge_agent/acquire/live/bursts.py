"""Whether much comes at once, after a pause: something on the way has held it back."""

PAUSE_S = 0.25
SPACINGS = 8
MADE_UP, WITHIN = 0.5, 0.25
"""A burst makes up for this part of a pause within this part of its length."""


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
