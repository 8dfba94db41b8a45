"""Laws that were proposed, in; each refitted with all constants to the free run, out."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Law, Place, Unmeasured
from slowtime.dynamics.plant import Plant

from .candidates import Candidate
from .floor import Noise
from .gap import whiteness
from .records import Trial
from .refit import Fit, refit, weights_of
from .values import with_values

KEPT = 6
"""How many labels are refitted."""
A_PLACE, A_KIND = 4, 2
"""How many of them sit at one place, and are of one kind."""

WIDE_S = 2.4
"""How far about an instant that was found a better one is looked for."""
WHITE = 1e-3
"""Chance of so large a chi squared from which a label leaves nothing."""
BEHIND, LITTLE = 5.0, 0.01
"""Times its chi squared along the force, and share of that without any, from which others are
then given up."""
LOUDER = 4.0
"""Standard deviations of chi squared about 1 from which the noise is listened to again."""

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
    best = found[0]
    enough = best.score - max(FAR, HALF_WAY * (best.score - found[-1].score), 2 * best.cost)
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
    beat: float | None = None,
    horizons: Sequence[float] = (1.0,),
) -> Named | None:
    """Add one effect to the model of a fit, and fit all of it to the free run again.

    Not to the end where that will not come near a cost to `beat`.
    """
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
            horizons=(0.4, 1.0) if plant.layout.states and len(horizons) == 1 else horizons,
            beat=beat,
        )
        fit = _switched(fit, trials, kinds, beat)
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    if not math.isfinite(fit.cost):
        return None
    return Named(effect, description, fit, evidence(fit, kinds))


def _switched(
    fit: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind], beat: float | None
) -> Fit:
    """Look for a better instant of a switch about one that leaves something.

    The misfit has a minimum for every period by which the instant may be wrong.
    """
    which = len(fit.plant.effects) - 1
    action = kinds[fit.plant.effects[which].kind].action
    if not isinstance(action, Law) or len(action.switches) != 1 or whiteness(fit) > WHITE:
        return fit
    at = fit.plant.parameters.index(("effect", which, action.switches[0]))

    def misfit(instant: float) -> float:
        values = fit.values.copy()
        values[at] = instant
        total = 0.0
        for number, trial in enumerate(trials):
            end = trial.start_s + trial.duration_s
            if not trial.start_s - WIDE_S <= fit.values[at] <= end + WIDE_S:
                continue
            outputs = fit.plant.simulate(
                values,
                trial.inputs,
                trial.rate_hz,
                state0=fit.states[number],
                start_s=trial.start_s,
            )
            weights = weights_of(trial, fit.noise, number)
            total += float(np.sum(weights.whitened(trial.measured - outputs) ** 2))
        return total if math.isfinite(total) else math.inf

    tried = fit.values[at] + np.linspace(-WIDE_S, WIDE_S, 61)
    best = float(min(tried, key=misfit))
    if abs(best - fit.values[at]) < WIDE_S / 60:
        return fit
    values = fit.values.copy()
    values[at] = best
    again = refit(
        fit.plant,
        trials,
        noise=fit.noise,
        values=values,
        states=fit.states,
        horizons=(1.0,),
        beat=beat,
    )
    return again if again.cost < fit.cost else fit


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
    horizons: Sequence[float] = (1.0,),
) -> list[Named]:
    """Refit each label; all are judged by the noise that the best of them leaves.

    Once one leaves nothing, others are given up that were far behind it along the force.
    Growing `horizons` lead to the right minimum where an effect is strong, and cost more.
    """
    noise: Noise | None = None
    found: list[Named] = []
    enough = math.inf
    for number, label in enumerate(labels):
        if isinstance(kinds[label.effect.kind].action, Unmeasured) or label.cost > enough:
            continue
        tick(label.effect, number)
        beat = min((n.fit.cost for n in found), default=None)
        named = refitted(before, label.effect, trials, kinds, noise, beat, horizons)
        if named is None:
            continue
        if noise is None:
            noise = named.fit.noise
        found.append(named)
        if whiteness(named.fit) > WHITE:
            enough = min(enough, max(BEHIND * label.cost, LITTLE * label.bare) + FAR)
    return _heard_again(sorted(found, key=lambda n: -n.score), trials, kinds)


def _heard_again(
    found: list[Named], trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> list[Named]:
    """Judge all by the noise that the best leaves, where they were fitted to another."""
    if not found or abs(found[0].fit.chi2_in_band - 1) < LOUDER * found[0].fit.in_band_sd:
        return found
    best = found[0]
    try:
        fit = refit(
            best.fit.plant,
            trials,
            values=best.fit.values,
            states=best.fit.states,
            horizons=(1.0,),
        )
    except FloatingPointError:
        return found
    again = [dataclasses.replace(best, fit=fit, score=evidence(fit, kinds))]
    again += [rescored(one, fit, trials, kinds) for one in found[1:]]
    return sorted(again, key=lambda n: -n.score)


def rescored(
    named: Named, best: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> Named:
    """Give the same fit its cost under the noise of another."""

    def misfit(fit: Fit, noise: Noise) -> float:
        return sum(
            float(np.sum(weights_of(trial, noise, i).whitened(left) ** 2))
            for i, (trial, left) in enumerate(zip(trials, fit.residual, strict=True))
        )

    fit = named.fit
    before, after = misfit(fit, fit.noise), misfit(fit, best.noise)
    share = after / max(before, 1e-300)
    again = dataclasses.replace(
        fit,
        noise=best.noise,
        cost=fit.cost - before + after,
        chi2_per_datum=fit.chi2_per_datum * share,
        chi2_in_band=fit.chi2_in_band * share,
    )
    return dataclasses.replace(named, fit=again, score=evidence(again, kinds))


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
