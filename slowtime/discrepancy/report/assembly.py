"""Assembly of the diagnosis: verdict and words from what a likelihood says of a campaign."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import Answer, Diagnosis, NamedEffect, Rival, Verdict
from slowtime.discrepancy.selection.probabilities import fault_of
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind, Place

from .outcome import CampaignOutcome, Outcome
from .sentences import (
    closing_sentence,
    contradiction,
    experiment_sentence,
    verdict_and_sentence,
)

Report = TypeVar("Report", bound=Answer)


def answered(
    report: Callable[..., Report],
    outcome: Outcome,
    answers: Sequence[NamedEffect],
    words: Callable[[Rival], str],
    closing: Callable[[Verdict], str] = lambda verdict: "",
    **rest: Any,
) -> Report:
    """Give a report of an outcome, in the same words for every likelihood.

    `words` gives the name of a rival and its place, `closing` further sentences under a
    verdict, and `rest` the fields of the report beyond those of `Answer`.
    """
    verdict, sentence = verdict_and_sentence(outcome, answers, words)
    sentence += experiment_sentence(verdict, outcome.experiment)
    return report(
        verdict=verdict,
        sentence=sentence + closing(verdict),
        effects=tuple(answers),
        undecided=tuple(outcome.undecided) if verdict == "undecided" else (),
        experiment=outcome.experiment,
        nothing_probability=outcome.nothing_probability,
        residual_white=outcome.residual_white,
        white_p_value=outcome.white_p_value,
        **rest,
    )


def assemble(
    given: Description,
    outcome: CampaignOutcome,
    findings: Sequence[Finding],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    """Put the diagnosis of a campaign together.

    A finding of the screening that is a fault of a channel is named beside the effects.
    """
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    answers = _once([*outcome.effects, *faults])
    gap, measure = outcome.gap, outcome.measure
    return answered(
        Diagnosis,
        outcome,
        answers,
        lambda rival: f"{kinds[rival.effect].words} at {rival.place}",
        lambda verdict: contradiction(verdict, gap) + closing_sentence(gap, measure),
        moved=outcome.moved,
        where=outcome.where,
        when=outcome.when,
        findings=tuple(findings),
        gap=gap,
        chi2_per_datum=outcome.chi2_per_datum,
        nominal=given,
        refitted=outcome.refitted,
        augmented=outcome.augmented,
        traces=outcome.traces,
        spectra=outcome.spectra,
        surface=outcome.surface,
        notes=tuple(outcome.notes),
        measured_force=outcome.measured_force,
        exhausted=outcome.exhausted,
    )


def _once(answers: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Keep the first answer for each kind and place."""
    kept: dict[tuple[str, Place], NamedEffect] = {}
    for answer in answers:
        kept.setdefault((answer.effect.kind, answer.effect.place), answer)
    return list(kept.values())
