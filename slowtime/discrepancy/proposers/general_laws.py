"""Proposer: laws that contain the simple ones, where no simple law explains the records."""

import dataclasses

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.library_fit import library_candidates
from slowtime.discrepancy.estimation.candidate_fit import best_of_each_place
from slowtime.discrepancy.selection.acceptance import is_second_curve
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import general_kinds

from .protocol import Proposal, Round

MAX_LAWS = 4
"""[candidates] Of general laws that are fitted. Source: each costs as much as a simple one, and
several contain each other."""


@dataclasses.dataclass(frozen=True, slots=True)
class GeneralLaws:
    """Proposes hysteresis, friction, damping and stiffness of general form.

    They have more parameters than simple laws, and imitate them: they are asked only where what
    the best simple law leaves is not noise.
    """

    name: str = "general laws"

    def __call__(self, given: Round) -> Proposal:
        """Propose the general laws that explain most of the recovered force."""
        best = given.best()
        explained = best is not None and (
            chi2_p_value(best) > LIMITS.coloured_p_value
            or best.chi2_in_band < LIMITS.explained_chi2
        )
        if explained or given.is_late("trying general laws", 0.22):
            return Proposal(self.name, ())
        among = general_kinds(given.kinds)
        found = [
            one
            for one in library_candidates(given.before, given.localized, given.kinds, among)
            if not is_second_curve(one.effect, given.hypothesis.effects, given.kinds)
        ]
        return Proposal(self.name, tuple(best_of_each_place(found, MAX_LAWS)))
