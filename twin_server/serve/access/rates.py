"""Limits the rate of requests of each caller by a token bucket, in bounded memory."""

from collections import OrderedDict
from collections.abc import Callable

CALLERS = 10_000
"""Those remembered at once; the one longest unheard of is forgotten first."""


class Rate:
    """Token buckets: a rate of requests a second for each caller, and a burst.

    Parameters
    ----------
    per_s, burst
        Of each caller.
    now
        A clock that never goes back [s].

    Examples
    --------
    >>> moment = 0.0
    >>> rate = Rate(per_s=2.0, burst=3, now=lambda: moment)
    >>> [rate.wait("a") for _ in range(4)], rate.wait("b")
    ([0.0, 0.0, 0.0, 0.5], 0.0)
    >>> moment = 10.0
    >>> rate.wait("a")
    0.0
    """

    def __init__(self, per_s: float, burst: int, now: Callable[[], float]) -> None:
        self._per_s, self._burst, self._now = per_s, float(burst), now
        self._callers: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait(self, caller: str) -> float:
        """Count one request; how long the caller must wait before the next [s], 0 for not."""
        now = self._now()
        left, since = self._callers.pop(caller, (self._burst, now))
        left = min(self._burst, left + (now - since) * self._per_s)
        allowed = left >= 1.0
        self._callers[caller] = (left - 1.0 if allowed else left, now)
        while len(self._callers) > CALLERS:
            self._callers.popitem(last=False)
        return 0.0 if allowed else (1.0 - left) / self._per_s
