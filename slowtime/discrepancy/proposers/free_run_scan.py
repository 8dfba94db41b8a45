"""Proposer: laws ranked by their free runs over whole free decays, where none comes near.

Where the free run of the model has lost the phase of a decay, the force recovered from what
is left follows the wrong motion. A weak damping law, as dry friction in a long free decay, is
then recognised by its own free run alone.
"""

import dataclasses
import math
from collections.abc import Iterator

from slowtime.discrepancy.calibration.augmentation import free_run_chi2
from slowtime.discrepancy.candidates.library_fit import Candidate, is_applicable
from slowtime.discrepancy.candidates.parameter_scan import (
    concatenate_motions,
    effects_of_strength,
    has_strength,
)
from slowtime.discrepancy.selection.acceptance import is_second_curve
from slowtime.discrepancy.selection.trial_order import fitted_numbers
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, Friction, Kind, Law, Place

from .protocol import Proposal, Round

LOST_CHI2 = 30.0
"""[noise variances] Mean square in band that the best candidate leaves, from which its free run
has lost the records. Source: as `UNTRACKED_CHI2` of `search/lost_records.py`."""
FORCE_RATIOS = (-0.1, -0.003, 0.0005, 0.003, 0.02, 0.1)
"""[1] Force of a law over that of the element's spring. Source: friction and drag of decays
that lose 0.1 to 30 % of their energy per cycle."""
MAX_SHAPES = 2
"""[1] Shapes of each law that are run. Source: a bound on computing time."""
MAX_PARAMETERS = 2
"""[parameters] That a law is fitted with at most. Source: a bound on computing time; laws of
more are begun from what these tell."""
MAX_LAWS = 12
"""[laws] That are fitted. Source: a bound on computing time."""


@dataclasses.dataclass(frozen=True, slots=True)
class FreeRunScan:
    """Proposes the laws whose free runs over whole decays leave least."""

    name: str = "free-run scan"

    def __call__(self, given: Round) -> Proposal:
        """Propose laws of elements; nothing where a candidate keeps to the records."""
        best = given.best()
        # A driven motion does not lose its phase: the force gives it again.
        driven = any(trial.inputs.any() for trial in given.trials)
        if driven or (best is not None and best.chi2_in_band < LOST_CHI2):
            return Proposal(self.name, ())
        found: list[tuple[float, Effect]] = []
        for kind, place in _sites(given):
            if given.is_late("running laws over whole records", 0.24):
                break
            nearest = min(
                (
                    (free_run_chi2(given.before, one, None, given.trials, given.kinds), i, one)
                    for i, one in enumerate(_laws(given, kind, place))
                ),
                default=None,
            )
            if nearest is not None and math.isfinite(nearest[0]):
                found.append((nearest[0], nearest[2]))
        # Before it is fitted, a free run ranks laws of as many parameters, and no others.
        found.sort(key=lambda one: (fitted_numbers(given.kinds[one[1].kind]), one[0]))
        bare = given.before.chi2_in_band * given.before.data
        # What a free run leaves before its fit says nothing of what it leaves after.
        cost = min((one.cost for one in given.shortlist), default=0.0)
        return Proposal(
            self.name,
            tuple(Candidate(one, cost, -cost / 2, bare) for _, one in found[:MAX_LAWS]),
        )


def _sites(given: Round) -> Iterator[tuple[Kind, Place]]:
    """List laws of force and the elements that they may act in."""
    description = given.before.plant.description
    kinds = [
        kind
        for kind in given.kinds.values()
        if kind.where == "element"
        and isinstance(kind.action, Law | Friction)
        and has_strength(kind)
        and not kind.is_surface
        and not kind.is_by_record
        and not kind.states
        and not (isinstance(kind.action, Law) and kind.action.switches)
        and fitted_numbers(kind) <= MAX_PARAMETERS
    ]
    for element in description.elements:
        if not isinstance(element, Spring):
            continue
        place = Place("element", element.id)
        for kind in kinds:
            law = Effect(kind.name, place, {})
            there = is_applicable(kind, place, description)
            if there and not is_second_curve(law, given.hypothesis.effects, given.kinds):
                yield kind, place


def _laws(given: Round, kind: Kind, place: Place) -> Iterator[Effect]:
    """Give a law in some shapes, as strong as parts of the element's spring."""
    before = given.before
    motion = concatenate_motions([run[place] for run in before.motions(given.trials)])
    values = dict(zip(before.plant.parameters, before.values.tolist(), strict=True))
    spring = values["stiffness", place.id] * motion.e
    described = before.plant.description
    yield from effects_of_strength(
        kind, place, motion, spring, described, FORCE_RATIOS, most=MAX_SHAPES
    )
