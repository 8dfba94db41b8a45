"""Shortlist of candidates that are fitted to the free run."""

from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.constant_equivalents import instead_of_constants
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    Label,
    label_of,
    mirrored_factor,
)
from slowtime.discrepancy.estimation.candidate_fit import (
    KEPT,
    FittedCandidate,
    best_of_each_place,
)
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

HASTY, LATER, TWICE = 3, 3, 2
"""Labels refitted where it is to be quick, and where more than one effect is missing; for the
later ones; and where what is left is left at a place that has an effect already."""
APART, LEADING = 0.4, 0.25
"""Share of what any other place leaves, and of what was missing, that one of several effects
leaves where it is told before the others."""


def shortlist(
    hypothesis: Hypothesis,
    before: Fit,
    located: Localization,
    tried: Sequence[Candidate],
    kinds: Mapping[str, Kind],
    *,
    number: int,
    quick: bool,
) -> list[Candidate]:
    """Choose what is refitted: fewer of the later effects, and where there is one already.

    Parameters
    ----------
    tried
        Laws with what they explain of the force, the best first.
    number
        How many effects were found.
    """
    # Twice at one place: what no single law explains there is more likely a law unknown.
    again = any(a.effect.place in located.groups[0].places for a in hypothesis.effects)
    # No force at one place does it: which of two comes first matters less than both.
    several = located.groups[0].left > LIMITS.several_forces_chi2
    most = HASTY if quick or several else KEPT
    labels = best_of_each_place(tried, (TWICE if again else LATER) if number else most)
    if len(before.plant.description.sensors) == 1:
        labels += mirrored_factor(labels, tried, kinds)
    if number == 0 and located.p_value > LIMITS.false_alarm_p_value:
        labels += instead_of_constants(before, labels, hypothesis.trials, kinds)
    return labels


def begun_with(named: Sequence[FittedCandidate], before: Fit, located: Localization) -> bool:
    """Whether one of several effects stands out and was told: the others come beside it."""
    best, *others = located.groups
    if (
        not named
        or named[0].effect.place not in best.places
        or best.left < LIMITS.several_forces_chi2
    ):
        return False
    alone = all(best.left < APART * other.left for other in others)
    return alone and named[0].fit.chi2_in_band < LEADING * before.chi2_in_band


def begins(one: FittedCandidate, label: Label | None, bent: Fit) -> bool:
    """Whether a law is the one that explains how records begin, and something of the rest."""
    return label_of(one.effect) == label and one.fit.chi2_in_band < bent.chi2_in_band
