"""Whether a fitted candidate does something that its records show."""

import math
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Hidden, Kind, Law, always
from slowtime.dynamics.plant import Name

from .model_evidence import FittedCandidate

NEGLIGIBLE_MASS_SHARE = 1e-3
"""[share of the node's mass] Of a hidden mass, below which it changes no response of a damped
structure noticeably. Source: a decision: it then shifts frequencies by less than 0.05 %."""


def is_significant(
    named: FittedCandidate, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> bool:
    """Whether what happened at an instant happened while somebody looked, or between."""
    which = len(named.fit.plant.effects) - 1
    action = kinds[named.effect.kind].action
    values = dict(zip(named.fit.plant.parameters, named.fit.values.tolist(), strict=True))
    switches = action.switches if isinstance(action, Law) else ()
    first = min(trial.start_s for trial in trials)
    last = max(trial.start_s + trial.duration_s for trial in trials)
    return all(first < values["effect", which, name] < last for name in switches)


def is_idle(named: FittedCandidate, kinds: Mapping[str, Kind]) -> bool:
    """Whether a law does nothing, to within its error: its other numbers fit."""
    kind = kinds[named.effect.kind]
    least = LIMITS.clear_sds if len(kind.parameters) == 1 else LIMITS.seen_sds
    # The gain of a law of one parameter has to show in that. A law of several is near the end
    # of its range where a simpler one does the same.
    which = kind.strength or _only(kind)
    name = ("effect", len(named.description.effects) - 1, which)
    return sds_of(named.fit, name, nothing_of(kind)) < least or _is_negligible_rider(
        named, kind
    )


def _is_negligible_rider(named: FittedCandidate, kind: Kind) -> bool:
    """Whether a hidden mass is negligible beside its node, and swings without damping."""
    # It does what a tone does, which any regular motion that is left looks like.
    if not isinstance(kind.action, Hidden) or not kind.action.coordinates or not kind.scales:
        return False
    number = len(named.description.effects) - 1
    values = dict(zip(named.fit.plant.parameters, named.fit.values.tolist(), strict=True))
    host = values.get(("mass", named.effect.place.id), 0.0)
    assert kind.strength is not None
    light = values["effect", number, kind.strength] < NEGLIGIBLE_MASS_SHARE * host
    return light and sds_of_strength(named.fit, number, kind) < LIMITS.seen_sds


def sds_of_strength(fit: Fit, number: int, kind: Kind) -> float:
    """How many standard deviations an effect is from nothing; endless where none is known."""
    which = [kind.strength or _only(kind), *kind.scales]
    return min(sds_of(fit, ("effect", number, one), nothing_of(kind)) for one in which)


def sds_of(fit: Fit, name: Name, nothing: float) -> float:
    """Distance of a parameter from another value [standard deviations]; infinite if held."""
    if name not in fit.prior.names:
        return math.inf
    at = fit.prior.names.index(name)
    apart, sd = abs(float(fit.free[at]) - nothing), float(fit.inflated_sd[at])
    return apart / sd if sd > 0 else (math.inf if apart else 0.0)


def _only(kind: Kind) -> str:
    """Name of the only number; none is called nothing."""
    return kind.names[0] if len(kind.names) == 1 else ""


def nothing_of(kind: Kind) -> float:
    """Value at which a kind of one number does nothing: 1 for factors, 0 for all else."""
    return 1.0 if kind.is_factor else 0.0


def is_shown(
    named: FittedCandidate, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> bool:
    """Whether the motion of the fit shows what sets the law apart from simpler ones."""
    kind, fit = kinds[named.effect.kind], named.fit
    if kind.shown is always:
        return True
    which = len(fit.plant.effects) - 1
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    numbers = {name: values["effect", which, name] for name in kind.names}
    return any(kind.shown(numbers, run[named.effect.place]) for run in fit.motions(trials))
