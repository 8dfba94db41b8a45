"""Trial of one of several effects at another place.

The place of a law was chosen while other effects were still missing, and a neighbouring place
explains most of what the right one does. Beside all other effects, the law is therefore tried
again at each place where it may act.
"""

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import (
    Fit,
    FitControl,
    try_refit,
)
from slowtime.discrepancy.calibration.augmentation import map_states, simulated_chi2
from slowtime.discrepancy.candidates.library_fit import is_applicable
from slowtime.discrepancy.estimation.candidate_fit import COARSE_HORIZONS
from slowtime.discrepancy.estimation.switching_instant import refine_switching_instant
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import requote_all
from slowtime.discrepancy.selection.probabilities import first_doubts
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.time_limit import leave_out
from slowtime.dynamics.effects import Kind, Place
from slowtime.dynamics.plant import Plant

from .elimination import left_out

STRENGTH_FACTORS = (1.0, 0.25, 0.5, 2.0, 4.0)
"""[1] On the strength of a law at the start of its fit at another place: an element that moves
less needs more of it. Source: docs/what_decides.md: half and double change no answer."""


def relocate(
    hypothesis: Hypothesis,
    kinds: Mapping[str, Kind],
    tell: Monitor,
    *,
    least: int = 2,
    among: Collection[str] = (),
) -> Hypothesis:
    """Put a law at another place, where that explains more.

    It is tried from `least` effects on: a single law was compared at all places when it was
    found, unless constants give way as they do in a reduced model. Each place needs as many
    parameters of the law: the likelier leaves less. Only places in `among` come into question;
    any where it is empty.
    """
    last, trials = hypothesis.last, hypothesis.trials
    whole = hypothesis.last_fits_whole_records and hypothesis.holds is None
    settled = hypothesis.final or hypothesis.without_sensor
    if len(hypothesis.effects) < least or not whole or settled:
        return hypothesis
    best, which, exhausted = last, -1, hypothesis.exhausted
    for number, place in _other_places(hypothesis, kinds):
        if among and place.id not in among:
            continue
        if tell.is_over or leave_out("a comparison of effects at other places"):
            exhausted = True
            break
        effect = hypothesis.effects[number].effect
        tell(f"trying {effect.kind} at {place}", 0.8)
        other = _with(best, number, place, hypothesis, kinds, lambda: tell.is_over)
        if other is not None and other.cost < best.cost - 2 * LIMITS.least_log_evidence:
            best, which = other, number
    if best is last:
        same = exhausted == hypothesis.exhausted
        return hypothesis if same else dataclasses.replace(hypothesis, exhausted=exhausted)
    fits = [hypothesis.first, *left_out(hypothesis.fits, which, best, trials, kinds)]
    effects = list(requote_all(hypothesis.effects, best, kinds))
    effects[which] = dataclasses.replace(effects[which], rivals=())  # of the place it had
    return dataclasses.replace(
        hypothesis.with_effects(fits, effects),
        undecided=first_doubts(effects),
        pair=None,
        constants_suffice=False,
        exhausted=exhausted,
    )


def _other_places(
    hypothesis: Hypothesis, kinds: Mapping[str, Kind]
) -> Iterator[tuple[int, Place]]:
    """Give laws and other places for them: the first that was found first."""
    structure = hypothesis.last.plant.description
    every = {
        "element": [element.id for element in structure.elements],
        "node": [node.id for node in structure.nodes],
    }
    taken = {(answer.effect.kind, answer.effect.place) for answer in hypothesis.effects}
    for number, answer in enumerate(hypothesis.effects):
        sort = answer.effect.place.kind
        for name in every.get(sort, ()):
            place = Place(sort, name)
            there = is_applicable(kinds[answer.effect.kind], place, structure)
            if there and (answer.effect.kind, place) not in taken:
                yield number, place


def _with(
    fit: Fit,
    number: int,
    place: Place,
    hypothesis: Hypothesis,
    kinds: Mapping[str, Kind],
    late: Callable[[], bool],
) -> Fit | None:
    """Refit a model with one of its effects at another place; None where that is worse."""
    last, trials = hypothesis.last, hypothesis.trials
    description = last.plant.description
    at = len(description.effects) - len(hypothesis.effects) + number
    entry = {**description.effects[at], place.kind: place.id}
    effects = tuple(entry if i == at else e for i, e in enumerate(description.effects))
    plant = Plant.of(dataclasses.replace(description, effects=effects), kinds=kinds)
    states = map_states(last, plant)
    values = min(
        _as_strong(plant, last, at, kinds[str(entry["effect"])]),
        key=lambda values: simulated_chi2(plant, values, states, last.noise, trials),
    )
    other = try_refit(
        plant, trials, noise=last.noise, values=values, states=states,
        horizons=COARSE_HORIZONS, control=FitControl(cost_to_beat=fit.cost, is_late=late),
    )  # fmt: skip
    if other is None:
        return None
    return refine_switching_instant(other, trials, kinds, fit.cost, np.inf, at)


def _as_strong(
    plant: Plant, last: Fit, at: int, kind: Kind
) -> Iterator[Float[np.ndarray, " parameter"]]:
    """Give the values of a fit, the law as strong as it was, and weaker and stronger."""
    which = [] if kind.strength is None else [kind.strength, *kind.scales]
    of_strength = [plant.parameters.index(("effect", at, name)) for name in which]
    for factor in STRENGTH_FACTORS if which else (1.0,):
        values = last.values.copy()
        values[of_strength] *= factor
        yield values
