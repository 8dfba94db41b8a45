"""Proposer: pairs of laws that the measured motion tells, where no law alone explains much."""

import numpy as np

from slowtime.discrepancy.candidates.measured_pairs import measured_pairs
from slowtime.discrepancy.localization import measured_motion
from slowtime.discrepancy.thresholds import LIMITS

from .joint_pairs import Pair
from .protocol import Round, reached_by_shortlist


def pairs_along_measured_motion(given: Round) -> list[Pair]:
    """Give the pairs of laws that explain most, where each law leaves more than one force does.

    None where sensors do not tell the motion of all coordinates.
    """
    data = sum(2 * lines.residual.size for lines in given.localized.lines)
    enough = reached_by_shortlist(given.tried) <= LIMITS.several_forces_chi2 * data
    if enough or given.is_late("comparing pairs of laws along the measured motion", 0.05):
        return []
    try:
        located = measured_motion(given.before, given.trials)
        return [] if located is None else measured_pairs(given.before, located, given.kinds)
    except (np.linalg.LinAlgError, FloatingPointError):
        return []
