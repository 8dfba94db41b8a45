"""Fitted models with one effect added or removed, and the start of their own fits."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.plant import Name, Plant

from .fit import Fit, try_refit
from .levenberg_marquardt import FitControl
from .model_values import with_values
from .spectral_weights import spectral_weights


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FitStart:
    """Values to start the fit of a law from.

    Parameters
    ----------
    states
        Initial state of each trial, by the names of the coordinates.
    from_segments
        Whether they were fitted to segments of the records only, so that longer runs may leave
        the basin of the minimum.
    """

    constants: Mapping[tuple[str, str], float]
    states: Sequence[Mapping[tuple[str, str], float]]
    from_segments: bool = False


def with_effect(description: Description, effect: Effect) -> Description:
    """Add an effect to a description."""
    return dataclasses.replace(description, effects=(*description.effects, effect.entry()))


def augmented_start(
    before: Fit, effect: Effect, kinds: Mapping[str, Kind], start: FitStart | None = None
) -> tuple[Plant, Float[np.ndarray, " parameter"], list[Float[np.ndarray, " state"]]]:
    """Build a model with one more effect, and the start of its fit.

    It starts as `before` ended where no start is given. Gives the model, whose priors stay
    those of the nominal constants, values of all its constants, and the initial state of each
    trial.
    """
    plant = Plant.of(with_effect(before.plant.description, effect), kinds=kinds)
    known: dict[Name, float] = dict(
        zip(before.plant.parameters, before.values.tolist(), strict=True)
    )
    if start is None:
        states = map_states(before, plant)
    else:
        known.update(start.constants.items())
        names = plant.state_names
        states = [np.array([one.get(n, 0.0) for n in names]) for one in start.states]
    values = np.array([known.get(name, entry.value) for name, entry in plant.entries.items()])
    return plant, values, states


def carry_effect(before: Fit, effect: Effect, kinds: Mapping[str, Kind]) -> Fit:
    """Add an effect to the model of a fit without fitting anything."""
    plant = Plant.of(with_effect(before.plant.description, effect), kinds=kinds)
    values = np.concatenate([before.values, plant.values[len(before.values) :]])
    states = tuple(map_states(before, plant))
    return dataclasses.replace(before, plant=plant, values=values, states=states)


def free_run_chi2(
    before: Fit,
    effect: Effect,
    start: FitStart | None,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> float:
    """Chi squared of the free run from which the fit of an added effect would start."""
    plant, values, states = augmented_start(before, effect, kinds, start)
    return simulated_chi2(plant, values, states, before.noise, trials)


def simulated_chi2(
    plant: Plant,
    values: Float[np.ndarray, " parameter"],
    states: Sequence[Float[np.ndarray, " state"]],
    noise: Noise,
    trials: Sequence[Trial],
    numbers: Sequence[int] | None = None,
) -> float:
    """Chi squared of free runs of some trials, or all; infinite where one is unbounded."""
    total = 0.0
    for number in range(len(trials)) if numbers is None else numbers:
        trial = trials[number]
        outputs = plant.simulate(
            values,
            trial.inputs,
            trial.rate_hz,
            state0=states[number],
            start_s=trial.start_s,
        )
        total += spectral_weights(trial, noise, number).chi2(trial.measured - outputs)
    return total if math.isfinite(total) else math.inf


def map_states(before: Fit, plant: Plant) -> list[np.ndarray]:
    """Map the initial states of a fit to another plant; new coordinates are at rest."""
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


def fitted_effects(fit: Fit) -> list[Effect]:
    """Effects of the model of a fit, in order, with their fitted parameters."""
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return described_effects(with_values(fit.plant.description, values))


def described_effects(description: Description) -> list[Effect]:
    """Effects of a description, in order."""
    found = []
    for entry in description.effects:
        rest = {key: value for key, value in entry.items() if key != "effect"}
        kind = next((k for k in ("element", "node", "input", "sensor") if k in rest), "base")
        place = Place(kind, str(rest.pop(kind, "base")))  # type: ignore[arg-type]
        found.append(Effect(str(entry["effect"]), place, rest))
    return found


def refit_without(
    fit: Fit, number: int, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> Fit | None:
    """Refit a model without one of its effects.

    The fit ends early where it will not reach the cost of the whole model; None where its free
    run grows beyond bounds.
    """
    description = fit.plant.description
    effects = tuple(e for i, e in enumerate(description.effects) if i != number)
    plant = Plant.of(dataclasses.replace(description, effects=effects), kinds=kinds)
    known = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))

    def before(name: Name) -> Name:
        if len(name) == 3 and name[1] >= number:
            return name[0], name[1] + 1, name[2]
        return name

    values = np.array(
        [known.get(before(name), entry.value) for name, entry in plant.entries.items()]
    )
    states = states_without(fit, number) if len(fit.states) == len(trials) else None
    return try_refit(
        plant, trials, noise=fit.noise, values=values, states=states, horizons=(1.0,),
        control=FitControl(cost_to_beat=fit.cost),
    )  # fmt: skip


def states_without(fit: Fit, number: int) -> list[Float[np.ndarray, " state"]]:
    """Drop the hidden coordinates of an effect from the initial states of a fit."""
    names = fit.plant.state_names
    gone = f"{fit.plant.effects[number].kind} {number}."
    kept = [i for i, (_, name) in enumerate(names) if not name.startswith(gone)]
    return [state[kept] if state.size else state for state in fit.states]
