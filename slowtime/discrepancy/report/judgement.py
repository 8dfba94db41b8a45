"""Verdict on a hypothesis, with the doubts that held-out records raise."""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import NamedEffect, Rival, Verdict
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.doubts import doubt_laws, doubt_pieces
from slowtime.discrepancy.selection.inadequacy import (
    MAX_AMPLITUDE_LEFT,
    law_probability,
    temper_unexplained,
)
from slowtime.discrepancy.selection.many_laws import temper_many_laws
from slowtime.discrepancy.selection.probabilities import fault_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.holdout import is_confirmed_on_holdout
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind, Place

from .evaluation import Evaluation
from .explanation import is_unknown, nearest_effects
from .sentences import verdict_and_sentence


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judgement:
    """Verdict on a hypothesis, after its free runs on records that were not fitted.

    Parameters
    ----------
    unknown
        Whether something is missing that is none of the effects known here.
    answers
        Effects and faults of sensors, each with its probability.
    """

    found: Hypothesis
    unknown: bool
    answers: tuple[NamedEffect, ...]
    verdict: Verdict
    sentence: str


def judge(
    given: Description,
    found: Hypothesis,
    evaluation: Evaluation,
    findings: Sequence[Finding],
    kinds: Mapping[str, Kind],
) -> Judgement:
    """Judge a hypothesis by what it leaves, and by records that were not fitted.

    Parameters
    ----------
    evaluation
        Free runs on records that were not fitted.
    """
    found = _doubted(found, evaluation, kinds)
    unknown = is_unknown(found, evaluation, kinds)
    found = found if unknown else _near_unknown(found)
    answers = _answers(given, found, () if unknown else found.effects, findings, kinds)
    nearest = nearest_effects(found, evaluation, kinds)
    verdict, sentence = verdict_and_sentence(
        given, found, answers, nearest, kinds, unknown=unknown
    )
    return Judgement(
        found=found, unknown=unknown, answers=tuple(answers), verdict=verdict,
        sentence=sentence,
    )  # fmt: skip


def _doubted(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Doubt curves that may be pieces of one, and laws that a held-out record contradicts."""
    if not found.undecided and not found.final:
        found = doubt_pieces(found, kinds)
    if not evaluation.held_out or found.undecided or found.final:
        return found
    if chi2_p_value(found.last) <= LIMITS.coloured_p_value:
        return found
    if evaluation.errors[-1] < MAX_AMPLITUDE_LEFT * evaluation.errors[0]:
        return found
    excess = evaluation.errors[-1] / evaluation.floor
    confirmed = is_confirmed_on_holdout(found.last, excess, evaluation.tests)
    return found if confirmed else doubt_laws(found, kinds)


def _near_unknown(found: Hypothesis) -> Hypothesis:
    """Say that laws near those found may be the true ones, where these leave much."""
    decided = law_probability(found) >= LIMITS.decided_probability
    if decided or found.undecided or found.final or not found.effects:
        return found
    share = law_probability(found)
    return dataclasses.replace(
        found,
        near_unknown=True,
        undecided=tuple(
            Rival(a.effect.kind, a.effect.place, share * a.probability) for a in found.effects
        ),
        pair=tuple(found.fitted[:2]) if len(found.fitted) > 1 else None,
    )


def _answers(
    given: Description,
    found: Hypothesis,
    effects: Sequence[NamedEffect],
    findings: Sequence[Finding],
    kinds: Mapping[str, Kind],
) -> list[NamedEffect]:
    """Give effects, less sure where they are many, and faults that screening found."""
    assert found.localized is not None
    alike = bool(found.localized.groups[0].twins)
    several = temper_many_laws(effects, len(found.fits) - 1, kinds, alike=alike)
    sure = temper_unexplained(several, found)
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    return _once([*sure, *faults])


def _once(answers: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Keep the first answer for each kind and place."""
    kept: dict[tuple[str, Place], NamedEffect] = {}
    for answer in answers:
        kept.setdefault((answer.effect.kind, answer.effect.place), answer)
    return list(kept.values())
