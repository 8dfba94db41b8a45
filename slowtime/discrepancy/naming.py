"""Laws that were proposed, in; each refitted with all constants to the free run, out."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place, Unmeasured
from slowtime.dynamics.plant import Plant

from .candidates import Candidate
from .floor import Noise
from .records import Trial
from .refit import Fit, refit
from .values import with_values

KEPT = 6
"""How many labels are refitted."""
A_PLACE, A_KIND = 4, 2
"""How many of them sit at one place, and are of one kind."""

FAR, HALF_WAY = 40.0, 0.3
"""Log evidence behind the best, also relative to the worst, from which a label is given up."""

REARED = {"extra_dof": 6.0}
"""Log odds against kinds that explain almost anything weakly."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Named:
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


def chosen(found: Sequence[Candidate], most: int = KEPT) -> list[Candidate]:
    """Take the best, of several kinds at several places."""
    if not found:
        return []
    kept: list[Candidate] = []
    enough = found[0].score - max(FAR, HALF_WAY * (found[0].score - found[-1].score))
    for one in found:
        if one.score < enough:
            break
        place = sum(k.effect.place == one.effect.place for k in kept)
        kind = sum(k.effect.kind == one.effect.kind for k in kept)
        if place < A_PLACE and kind < A_KIND:
            kept.append(one)
        if len(kept) == most:
            break
    return kept


def with_effect(description: Description, effect: Effect) -> Description:
    """Write one more effect into a description."""
    return dataclasses.replace(description, effects=(*description.effects, effect.entry()))


def evidence(fit: Fit, kinds: Mapping[str, Kind], noise_scale: float = 1.0) -> float:
    """Log evidence of a fit by Schwarz's criterion; constants carry their own priors."""
    numbers = sum(name[0] == "effect" for name in fit.prior.names)
    against = sum(REARED.get(effect.kind, 0.0) for effect in fit.plant.effects)
    return -fit.cost / (2 * noise_scale) - numbers / 2 * math.log(fit.data) - against


def refitted(
    before: Fit,
    effect: Effect,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    noise: Noise | None,
) -> Named | None:
    """Add one effect to the model of a fit, and fit all of it to the free run again."""
    # Priors stay those of the nominal constants; what was found so far is where to start.
    description = with_effect(before.plant.description, effect)
    plant = Plant.of(description, kinds=kinds)
    known = dict(zip(before.plant.parameters, before.values.tolist(), strict=True))
    values = np.array([known.get(name, entry.value) for name, entry in plant.entries.items()])
    try:
        fit = refit(
            plant,
            trials,
            noise=noise,
            values=values,
            states=_states(before, plant),
            horizons=(0.4, 1.0) if plant.layout.states else (1.0,),
        )
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    if not math.isfinite(fit.cost):
        return None
    return Named(effect, description, fit, evidence(fit, kinds))


def carrying(before: Fit, effect: Effect, kinds: Mapping[str, Kind]) -> Fit:
    """Write an effect that moves nothing in the mean into the model of a fit."""
    plant = Plant.of(with_effect(before.plant.description, effect), kinds=kinds)
    values = np.concatenate([before.values, plant.values[len(before.values) :]])
    return dataclasses.replace(before, plant=plant, values=values)


def _states(before: Fit, plant: Plant) -> list[np.ndarray]:
    """Give initial states to more coordinates than there were; the new ones rest."""
    names = before.plant.state_names
    return [
        np.array(
            [
                dict(zip(names, state.tolist(), strict=True)).get(n, 0.0)
                for n in plant.state_names
            ]
        )
        if state.size
        else state
        for state in before.states
    ]


def refit_all(
    before: Fit,
    labels: Sequence[Candidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Callable[[Effect, int], None],
) -> list[Named]:
    """Refit each label; all are judged by the noise that the best of them leaves."""
    noise: Noise | None = None
    found: list[Named] = []
    for number, label in enumerate(labels):
        tick(label.effect, number)
        if isinstance(kinds[label.effect.kind].action, Unmeasured):
            continue
        named = refitted(before, label.effect, trials, kinds, noise)
        if named is None:
            continue
        if noise is None:
            noise = named.fit.noise
        found.append(named)
    return sorted(found, key=lambda n: -n.score)


def settled(named: Named) -> Effect:
    """Give the effect as it was fitted last."""
    values = dict(zip(named.fit.plant.parameters, named.fit.values.tolist(), strict=True))
    return effects_of(with_values(named.description, values))[-1]


def effects_of(description: Description) -> list[Effect]:
    """Effects of a description, in order."""
    found = []
    for entry in description.effects:
        rest = {key: value for key, value in entry.items() if key != "effect"}
        kind = next((k for k in ("element", "node", "input", "sensor") if k in rest), "base")
        place = Place(kind, str(rest.pop(kind, "base")))  # type: ignore[arg-type]
        found.append(Effect(str(entry["effect"]), place, rest))
    return found
