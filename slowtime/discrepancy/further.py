"""Refits that leave far more than noise, in; what stood further down the list, out.

Candidates are ranked by a motion that was recovered with the wrong law. Where the force that is
missing is strong, the right one may stand low: as long as nothing tried explains the records,
it costs little to go on, one law of each kind and place.
"""

from collections.abc import Callable, Mapping, Sequence

from slowtime.dynamics.effects import Effect, Kind

from .candidates import Candidate
from .naming import Named, refit_all
from .records import Trial
from .refit import Fit

FAR_OFF = 5.0
"""Mean square over the noise, in band, that no right law leaves."""
AT_MOST, AT_ONCE = 6, 2
"""Labels that are tried further, and how many before one looks again."""


def further(
    before: Fit,
    tried: Sequence[Candidate],
    named: Sequence[Named],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Callable[[Effect, int], None],
) -> list[Named]:
    """Try more labels where the best leaves far more than noise; all, the best first.

    Parameters
    ----------
    tried
        Candidates, the best first.
    named
        Those that were refitted, the best first.
    """
    found = list(named)
    done = {(one.effect.kind, one.effect.place) for one in found}
    rest = [one for one in tried if (one.effect.kind, one.effect.place) not in done][:AT_MOST]
    while found and rest and found[0].fit.chi2_in_band > FAR_OFF:
        found += refit_all(before, rest[:AT_ONCE], trials, kinds, tick)
        found.sort(key=lambda one: -one.score)
        rest = rest[AT_ONCE:]
    return found
