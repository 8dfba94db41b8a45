"""Refits that leave far more than noise, in; what stood further down the list, out.

Candidates are ranked by a motion that was recovered with the wrong law. Where the force that is
missing is strong, the right one may stand low: as long as nothing tried explains the records,
it costs little to go on, one law of each kind and place. And where one stood far above all
others, and still leaves much, its free run may have settled in a minimum of its own: it is
fitted once more to the beginnings of the records, then to more and more of them.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects import Effect, Kind, Place

from .candidates import Candidate
from .naming import Named, refit_all, rescored
from .records import Trial
from .refit import Fit

FAR_OFF = 5.0
"""Mean square over the noise, in band, that no right law leaves."""
GROWING = (0.05, 0.1, 0.2, 0.35, 0.55, 0.75, 1.0)
"""Shares of the records that are fitted one after the other; more steps lose fewer minima."""
FOREMOST = 2
"""Labels, as ranked along the force, that are fitted so."""
AT_MOST, AT_ONCE = 6, 2
"""Labels that are tried further, and how many before one looks again."""


def further(
    before: Fit,
    tried: Sequence[Candidate],
    named: Sequence[Named],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Callable[[Effect, int], None],
    most: int = AT_MOST,
) -> list[Named]:
    """Try more labels where the best leaves far more than noise; all, the best first.

    Parameters
    ----------
    tried
        Candidates, the best first.
    named
        Those that were refitted, the best first.
    most
        How many more labels are tried.
    """
    found = list(named)
    if not found or found[0].fit.chi2_in_band <= FAR_OFF:
        return found
    found = _joined(
        found, refit_all(before, tried[:FOREMOST], trials, kinds, tick, GROWING), trials, kinds
    )
    done = {_label(one.effect) for one in found}
    rest = [one for one in tried if _label(one.effect) not in done][:most]
    while rest and found[0].fit.chi2_in_band > FAR_OFF:
        more = refit_all(before, rest[:AT_ONCE], trials, kinds, tick)
        found = _joined(found, more, trials, kinds)
        rest = rest[AT_ONCE:]
    return found


def _label(effect: Effect) -> tuple[str, Place]:
    return effect.kind, effect.place


def _joined(
    found: Sequence[Named],
    more: Sequence[Named],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[Named]:
    """Judge all by the noise of the one that leaves least; keep the better of each label."""
    every = [*found, *more]
    least = min(every, key=lambda one: _left(one.fit))
    judged = [one if one is least else rescored(one, least.fit, trials, kinds) for one in every]
    kept: dict[tuple[str, Place], Named] = {}
    for one in sorted(judged, key=lambda one: -one.score):
        kept.setdefault(_label(one.effect), one)
    return list(kept.values())


def _left(fit: Fit) -> float:
    """Sum of the logarithms of the power that each sensor has left in each trial."""
    power = [np.mean(residual**2, axis=0) for residual in fit.residual]
    return float(np.sum(np.log(np.maximum(power, np.finfo(float).tiny))))
