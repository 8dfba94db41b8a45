"""Proposer: pairs of laws that the measured motion tells, where no law alone explains much."""

from slowtime.discrepancy.calibration import attempt
from slowtime.discrepancy.candidates.measured_pairs import measured_pairs
from slowtime.discrepancy.localization import measured_motion
from slowtime.discrepancy.thresholds import LIMITS

from .joint_pairs import LawPair
from .protocol import Round, reached_by_shortlist


def pairs_along_measured_motion(given: Round) -> list[LawPair]:
    """Give pairs of laws that explain most, where each leaves more than one force does."""
    data = sum(2 * lines.residual.size for lines in given.localized.lines)
    enough = reached_by_shortlist(given.tried) <= LIMITS.several_forces_chi2 * data
    if enough or given.is_late("comparing pairs of laws along the measured motion", 0.05):
        return []
    located = attempt(measured_motion, given.before, given.trials)
    if located is None:
        return []
    return attempt(measured_pairs, given.before, located, given.kinds) or []
