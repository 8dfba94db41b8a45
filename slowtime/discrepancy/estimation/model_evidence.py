"""Candidates as fitted, and the evidence for each."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import Fit, spectral_weights
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.parameter_scan import is_constant_change
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, OpenJoint
from slowtime.dynamics.effects import Effect, Kind, Law, Place
from slowtime.dynamics.plant import Name

KIND_PENALTIES = {"extra_dof": 6.0}
"""[nats] Log odds against kinds that explain almost anything weakly. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FittedCandidate:
    """A model with one more effect, refitted.

    Parameters
    ----------
    score
        Log evidence, but for what all share: half of chi squared and priors, half a log of
        the data for each parameter of its effects.
    """

    effect: Effect
    description: Description
    fit: Fit
    score: float
    shot: Fit | None = None


def evidence(fit: Fit, kinds: Mapping[str, Kind], noise_scale: float = 1.0) -> float:
    """Log evidence of a fit by Schwarz's criterion; constants carry their own priors."""
    # Instants that fall between records are not charged for, because the records do not narrow
    # them down. All open joints together are as probable as one element, so that many do not
    # outvote it.
    numbers = sum(name[0] == "effect" for name in fit.prior.names) - len(
        undetermined_parameters(fit)
    )
    against = sum(KIND_PENALTIES.get(effect.kind, 0.0) for effect in fit.plant.effects)
    against += numbers / 2 * math.log(fit.data)
    against += sum(
        log_joints(effect.place, fit.plant.description) for effect in fit.plant.effects
    )
    for number, effect in enumerate(fit.plant.effects):
        if is_constant_change(kinds[effect.kind]):
            against -= _spared(fit, ("effect", number, kinds[effect.kind].names[0]))
    against -= sum(_at_natural_value(fit, name) for name in fit.prior.names)
    return -fit.cost / (2 * noise_scale) - against


def log_joints(place: Place, description: Description) -> float:
    """Logarithm of the number of open joints, where a place is one of them; else 0."""
    among = (
        joint.among
        for joint in description.elements
        if isinstance(joint, OpenJoint) and place == Place("element", joint.id)
    )
    return math.log(next(among, 1))


def natural_value(fit: Fit, name: Name) -> tuple[float, float] | None:
    """Value of a parameter in the simplest form of its law, and its sd; None without such."""
    if len(name) != 3:
        return None
    effect = fit.plant.effects[int(name[1])]
    natural = fit.plant.kinds[effect.kind].parameter(str(name[2])).natural
    if natural != "stiffness":
        return None if natural is None else (natural, 0.0)
    own = ("stiffness", effect.place.id)
    if own not in fit.plant.entries:
        return None
    sd = fit.sd[fit.prior.names.index(own)] if own in fit.prior.names else 0.0
    return float(fit.values[list(fit.plant.entries).index(own)]), float(sd)


def sds_from_natural_value(fit: Fit, name: Name) -> float:
    """Deviation of a parameter from its natural value [sds]; infinite where it has none."""
    natural = natural_value(fit, name)
    if natural is None or name not in fit.prior.names:
        return math.inf
    at = fit.prior.names.index(name)
    return abs(float(fit.free[at]) - natural[0]) / max(
        math.hypot(float(fit.sd[at]), natural[1]), 1e-300
    )


def _at_natural_value(fit: Fit, name: Name) -> float:
    """Log evidence that a parameter does not cost where it stands at its natural value."""
    # Held there, it would be none; half its squared deviation is what that would leave.
    return max(math.log(fit.data) / 2 - sds_from_natural_value(fit, name) ** 2 / 2, 0.0)


def _spared(fit: Fit, name: Name) -> float:
    """Log evidence that Schwarz takes from a number which no record can narrow down further."""
    # A constant and an effect like it share one sum; the effect is known as well as the
    # constant is claimed, from anything up to its own size, and that narrowing is all it has
    # cost.
    if name not in fit.prior.names:
        return 0.0
    at = fit.prior.names.index(name)
    narrowed = math.log(max(abs(float(fit.free[at])) / float(fit.sd[at]), 1.0))
    return max(math.log(fit.data) / 2 - narrowed, 0.0)


def undetermined_parameters(fit: Fit) -> tuple[Name, ...]:
    """Instants of switches that no record determines, because they fall between two."""
    found: list[Name] = []
    for name, value, sd in zip(fit.prior.names, fit.free, fit.sd, strict=True):
        if len(name) != 3:
            continue
        action = fit.plant.kinds[fit.plant.effects[name[1]].kind].action
        if isinstance(action, Law) and name[2] in action.switches and not sd < abs(value):
            found.append(name)
    return tuple(found)


def misfit(fit: Fit, noise: Noise, trials: Sequence[Trial]) -> float:
    """Chi squared of the residual of a fit under another noise of the same trials [1]."""
    return sum(
        spectral_weights(trial, noise, i).chi2(left)
        for i, (trial, left) in enumerate(zip(trials, fit.residual, strict=True))
    )


def rescored(
    named: FittedCandidate, best: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> FittedCandidate:
    """Give the same law its score under the noise of another."""
    again = with_noise(named.fit, best.noise, trials)
    return dataclasses.replace(named, fit=again, score=evidence(again, kinds))


def with_noise(fit: Fit, noise: Noise, trials: Sequence[Trial]) -> Fit:
    """Give the same fit its cost and chi squared under another noise of the same trials."""
    before, after = misfit(fit, fit.noise, trials), misfit(fit, noise, trials)
    share = after / max(before, 1e-300)
    return dataclasses.replace(
        fit,
        noise=noise,
        cost=fit.cost - before + after,
        chi2_per_datum=fit.chi2_per_datum * share,
        chi2_in_band=fit.chi2_in_band * share,
    )


def fitted_effect(named: FittedCandidate) -> Effect:
    """Give the effect as it was fitted last."""
    return fitted_effects(named.fit)[-1]
