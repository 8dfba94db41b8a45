r"""How much each site and token has used lately, so that who has used least goes first.

Usage fades by halves, as in fair-share schedulers of computing centres [1]_: of a site that
uses a share :math:`u` of a resource all the time, :math:`u h / \ln 2` is counted, with
half-life :math:`h`. A site that comes back after a pause goes first until it has caught up, and
one that waits long enough is always the one that has used least.

References
----------
.. [1] J. Kay and P. Lauder, "A fair share scheduler", Communications of the ACM 31 (1988),
   44-55.
"""

import threading
import time
from collections.abc import Callable

from .holders import Holder

HALF_LIFE_S = 300.0
"""Time after which half of a usage is forgotten [s]: some diagnoses long, so that a site that
asks now and then goes before those that never stop; short beside a working day."""

FORGOTTEN_S = 1e-3
"""Usage that counts as none [s]: less than a turn takes."""

SWEPT = 1_000
"""Entries from which on those that have faded are dropped."""


class DecayedUsage:
    """Seconds used by each site, and by each token of it, halved with every half-life.

    Examples
    --------
    >>> moment = 0.0
    >>> used = DecayedUsage(half_life_s=10.0, now=lambda: moment)
    >>> used.add(Holder("a", "t"), 8.0)
    >>> moment = 20.0
    >>> used.rank(Holder("a", "t")), used.rank(Holder("a", "new")), used.rank(Holder("b", "t"))
    ((2.0, 2.0), (2.0, 0.0), (0.0, 0.0))
    """

    def __init__(
        self, half_life_s: float = HALF_LIFE_S, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._half_life_s, self._now = half_life_s, now
        self._lock = threading.Lock()
        self._used: dict[str | Holder, tuple[float, float]] = {}

    def add(self, holder: Holder, seconds: float) -> None:
        """Count what a token of a site has used."""
        with self._lock:
            for key in (holder.site, holder):
                self._used[key] = self._of(key) + seconds, self._now()
            if len(self._used) > SWEPT:
                kept = {k: v for k, v in self._used.items() if self._of(k) > FORGOTTEN_S}
                self._used = kept

    def rank(self, holder: Holder) -> tuple[float, float]:
        """Return what its site and what its token has used [s]; the lesser goes first."""
        return self._of(holder.site), self._of(holder)

    def _of(self, key: str | Holder) -> float:
        used, at = self._used.get(key, (0.0, 0.0))
        return used and used * 0.5 ** ((self._now() - at) / self._half_life_s)
