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
from slowtime.discrepancy.estimation.candidate_fit import MAX_CANDIDATES, best_of_each_place
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

QUICK_CANDIDATES = 3
"""[candidates] Refitted for the first effect in a quick search, and where several effects are
missing. Source: docs/decisions/0023."""
LATER_CANDIDATES = 3
"""[candidates] Refitted for each later effect. Source: a bound on computing time."""
SAME_PLACE_CANDIDATES = 2
"""[candidates] Refitted where the residual points to a place that has an effect. Source: a
bound on computing time."""
DOMINANT_PLACE_RATIO = 0.4
"""[1] Of what a force at the best place leaves to what one at any other leaves, up to which one
of several effects dominates. Source: docs/decisions/0030; docs/what_decides.md: half and double
change no answer."""
DOMINANT_REST_SHARE = 0.25
"""[share of what was missing] That its law leaves at most. Source: docs/decisions/0030;
docs/what_decides.md: half and double change no answer."""


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
    """Choose what is refitted: fewer of the later effects, and where there is one already."""
    # Twice at one place: what no single law explains there is more likely a law unknown.
    again = any(a.effect.place in located.groups[0].places for a in hypothesis.effects)
    # No force at one place does it: which of two comes first matters less than both.
    several = located.groups[0].left > LIMITS.several_forces_chi2
    most = QUICK_CANDIDATES if quick or several else MAX_CANDIDATES
    candidates = best_of_each_place(
        tried, (SAME_PLACE_CANDIDATES if again else LATER_CANDIDATES) if number else most
    )
    if len(before.plant.description.sensors) == 1:
        candidates += mirrored_factor(candidates, tried, kinds)
    if number == 0 and located.p_value > LIMITS.false_alarm_p_value:
        candidates += instead_of_constants(before, candidates, hypothesis.trials, kinds)
    return candidates


def begun_with(named: Sequence[FittedCandidate], before: Fit, located: Localization) -> bool:
    """Whether one of several effects stands out and was told: the others come beside it."""
    best, *others = located.groups
    if (
        not named
        or named[0].effect.place not in best.places
        or best.left < LIMITS.several_forces_chi2
    ):
        return False
    alone = all(best.left < DOMINANT_PLACE_RATIO * other.left for other in others)
    return alone and named[0].fit.chi2_in_band < DOMINANT_REST_SHARE * before.chi2_in_band


def begins(one: FittedCandidate, label: Label | None, bent: Fit) -> bool:
    """Whether a law is the one that explains how records begin, and something of the rest."""
    return label_of(one.effect) == label and one.fit.chi2_in_band < bent.chi2_in_band
