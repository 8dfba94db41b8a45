"""Several effects, found one by one, in; those that the others leave a need for, out.

What was named first was named while the others were still missing: once they are in, it may
have nothing left to explain, and its numbers are not those of the model that has them all.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.effects import Kind, Unmeasured
from slowtime.dynamics.plant import Name, Plant

from .adding import effects_in
from .diagnosis import Named as Answer
from .equivalent import alone_off
from .naming import CLEAR, GRADUALLY, evidence, sds_of_strength
from .records import Trial
from .refit import WRONG, Fit, refit
from .verdict import LEAST_GAIN, numbers_of, sentence_of


def pruned(
    fits: Sequence[Fit],
    answers: Sequence[Answer],
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> tuple[list[Fit], list[Answer]]:
    """Leave out effects without which the rest does as well, and read numbers off the last fit.

    Parameters
    ----------
    fits
        Of the nominal model, and after each effect.
    answers
        One for each effect, in order.

    A constant that would be far off by itself is no needless effect, whatever the two fits
    leave: of friction, each may be stuck in another minimum.
    """
    chain, kept = list(fits), list(answers)
    if len(kept) < 2 or any(isinstance(kinds[a.effect.kind].action, Unmeasured) for a in kept):
        return chain, kept
    own = len(fits[0].plant.effects)
    number = 0
    while number < len(kept) and len(kept) > 1:
        less = without(chain[-1], own + number, trials, kinds)
        if less is not None and _lost(less, chain[-1], own + number, kinds):
            less = _regrown(less, trials)
        if (
            less is None
            or alone_off(less, kept[number].effect)
            or _gain(chain[-1], less, trials, kinds) >= LEAST_GAIN
        ):
            number += 1
            continue
        del kept[number]
        chain = [chain[0], *left_out(chain, number, less, trials, kinds)]
        number = 0
    return chain, all_told_again(kept, chain[-1], kinds)


def _lost(less: Fit, more: Fit, number: int, kinds: Mapping[str, Kind]) -> bool:
    """Whether a model is far off for want of a law that does next to nothing.

    What tips over goes another way for a thousandth of its mass; then the fit without the law
    is in a minimum of its own.
    """
    kind = kinds[more.plant.effects[number].kind]
    faint = sds_of_strength(more, number, kind) < CLEAR
    return faint and more.chi2_in_band < WRONG < less.chi2_in_band


def _regrown(fit: Fit, trials: tuple[Trial, ...]) -> Fit:
    """Fit a model to ever longer parts of the records; the better of both."""
    try:
        again = refit(
            fit.plant, trials, noise=fit.noise, values=fit.values, states=fit.states,
            horizons=GRADUALLY,
        )  # fmt: skip
    except (np.linalg.LinAlgError, FloatingPointError):
        return fit
    return again if again.cost < fit.cost else fit


def without(
    fit: Fit, number: int, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> Fit | None:
    """Refit a model without one of its effects; None where that cannot be done."""
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
    states = _states_without(fit, number) if len(fit.states) == len(trials) else None
    try:
        found = refit(
            plant, trials, noise=fit.noise, values=values, states=states, horizons=(1.0,),
            beat=fit.cost,
        )  # fmt: skip
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    return found if math.isfinite(found.cost) else None


def _states_without(fit: Fit, number: int) -> list[Float[np.ndarray, " state"]]:
    """Give initial states of a model to what is left of it: without those of what went."""
    names = fit.plant.state_names
    gone = f"{fit.plant.effects[number].kind} {number}."
    kept = [i for i, (_, name) in enumerate(names) if not name.startswith(gone)]
    return [state[kept] if state.size else state for state in fit.states]


def _gain(more: Fit, less: Fit, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]) -> float:
    """Log evidence that the larger model has over the smaller, by one noise and the same data.

    What a clock that is off leaves without an end is out of the data while one is tried.
    """
    same = more
    if less.noise is not more.noise or less.data != more.data:
        same = refit(
            more.plant, trials, noise=less.noise, values=more.values, states=more.states,
            horizons=(1.0,),
        )  # fmt: skip
    return evidence(same, kinds) - evidence(less, kinds)


def left_out(
    chain: Sequence[Fit],
    number: int,
    less: Fit,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> list[Fit]:
    """Fits after each effect that is left: those before the one that went are still good."""
    count = len(less.plant.effects) - len(chain[0].plant.effects)
    good = chain[1 : min(number + 1, count)]
    missing: list[Fit] = [less]
    while len(good) + len(missing) < count:
        shorter = without(missing[0], len(missing[0].plant.effects) - 1, trials, kinds)
        if shorter is None:
            break
        missing.insert(0, shorter)
    return [*good, *missing]


def all_told_again(
    answers: Sequence[Answer], fit: Fit, kinds: Mapping[str, Kind]
) -> list[Answer]:
    """Give answers about the last effects of a fit the numbers that those have in it."""
    own = len(fit.plant.effects) - len(answers)
    return [told_again(answer, fit, own + i, kinds) for i, answer in enumerate(answers)]


def told_again(answer: Answer, fit: Fit, number: int, kinds: Mapping[str, Kind]) -> Answer:
    """Give an answer the numbers that its effect has in the last fit."""
    effect = effects_in(fit)[number]
    numbers = numbers_of(fit, number)
    return dataclasses.replace(
        answer,
        effect=effect,
        numbers=numbers,
        sentence=sentence_of(kinds[effect.kind], effect.place, numbers),
    )
