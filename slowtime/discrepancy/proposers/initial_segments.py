"""Candidates that explain the beginning of records whose free run goes astray.

Where an effect is strong, the motion of the model without it is soon another one: what is left
then points to the wrong place, and the free run of the right law, begun from there, ends in a
minimum of its own. Over the first few swings no run can get out of step. So every law is fitted
to these at every element, from a force about as strong as the element's own, and those that
leave least are tried on the whole.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

from slowtime.discrepancy.calibration import (
    Fit,
    FitControl,
    first_periods,
    refit,
    try_refit,
)
from slowtime.discrepancy.calibration.augmentation import (
    augmented_start,
    fitted_effects,
    free_run_chi2,
)
from slowtime.discrepancy.calibration.initial_states import refit_initial_states
from slowtime.discrepancy.candidates.library_fit import Candidate, is_applicable
from slowtime.discrepancy.candidates.parameter_scan import (
    concatenate_motions,
    effects_of_strength,
    has_strength,
)
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, Kind, Place, simple_kinds

START_FORCE_RATIOS = (-0.56, -0.1, 0.1, 0.56)
"""[1] Force of a law at the start of its fit over that of the element's spring. Source:
docs/decisions/0029 for the rule; docs/what_decides.md: half and double change no answer."""
SEGMENT_HORIZONS = (0.2, 0.35, 0.6, 1.0)
"""[share of the initial segments] Fitted one after the other. Source: docs/what_decides.md:
half and double change no answer."""
GIVE_UP_RATIO = 10.0
"""[1] Times what the best law leaves of the initial segments, from which another is given up.
Source: docs/decisions/0029; 1 lost one right law of nine, 10 none."""
MAX_PROPOSED = 4
"""[laws] That are proposed. Source: docs/decisions/0029."""


def initial_segment_candidates(
    before: Fit,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    late: Callable[[], bool],
    among: Sequence[Place] | None = None,
) -> list[Candidate]:
    """Give the laws at elements that leave least of how the records begin, the best first.

    Costs are what each, and the model without it, would leave of the records were they all as
    they begin. The constants of `before` are held to their tolerances.
    """
    heads = first_periods(before.plant, trials)
    before = refit_initial_states(before, heads)
    bare = refit(
        before.plant, heads, noise=before.noise, values=before.values, states=before.states,
        horizons=SEGMENT_HORIZONS,
    ).chi2_in_band * before.data  # fmt: skip
    started = sorted(_started(before, heads, kinds, among), key=lambda pair: pair[0])
    found: list[Candidate] = []
    least: float | None = None
    for _, effect in started:
        if late():
            break
        beat = None if least is None else GIVE_UP_RATIO * least
        fit = _fitted(before, effect, heads, kinds, beat, late)
        if fit is not None:
            cost = fit.chi2_in_band * before.data
            found.append(Candidate(fitted_effects(fit)[-1], cost, -cost / 2, bare))
            least = fit.cost if least is None else min(least, fit.cost)
    found.sort(key=lambda one: one.cost)
    return found[:MAX_PROPOSED]


def _started(
    before: Fit,
    heads: Sequence[Trial],
    kinds: Mapping[str, Kind],
    among: Sequence[Place] | None,
) -> Iterator[tuple[float, Effect]]:
    """Give each law at each element as its free run comes nearest, and what that leaves."""
    runs = list(before.motions(heads))
    stiffness = dict(zip(before.plant.parameters, before.values.tolist(), strict=True))
    for element in before.plant.description.elements:
        place = Place("element", element.id)
        if not isinstance(element, Spring) or (among is not None and place not in among):
            continue
        motion = concatenate_motions([run[place] for run in runs])
        spring = stiffness["stiffness", element.id] * motion.e
        for kind in simple_kinds(kinds):
            if not (
                has_strength(kind) and is_applicable(kind, place, before.plant.description)
            ):
                continue
            laws = effects_of_strength(
                kind, place, motion, spring, before.plant.description, START_FORCE_RATIOS
            )
            nearest = min(
                (
                    (free_run_chi2(before, effect, None, heads, kinds), number, effect)
                    for number, effect in enumerate(laws)
                ),
                default=None,
            )
            if nearest is not None and math.isfinite(nearest[0]):
                yield nearest[0], nearest[2]


def _fitted(
    before: Fit,
    effect: Effect,
    heads: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    beat: float | None,
    late: Callable[[], bool],
) -> Fit | None:
    plant, values, states = augmented_start(before, effect, kinds)
    return try_refit(
        plant, heads, noise=before.noise, values=values, states=states,
        horizons=SEGMENT_HORIZONS, control=FitControl(cost_to_beat=beat, is_late=late),
    )  # fmt: skip
