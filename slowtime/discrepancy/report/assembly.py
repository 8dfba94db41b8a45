"""Assembly of the diagnosis: verdict and words from what a likelihood says of a campaign."""

from collections.abc import Mapping, Sequence

from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import Diagnosis, NamedEffect
from slowtime.discrepancy.selection.probabilities import fault_of
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind, Place

from .outcome import Outcome
from .sentences import (
    closing_sentence,
    contradiction,
    experiment_sentence,
    verdict_and_sentence,
)


def assemble(
    given: Description,
    outcome: Outcome,
    findings: Sequence[Finding],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    """Put a diagnosis together, in the same words for every likelihood.

    Parameters
    ----------
    given
        Model as it was given.
    findings
        Of the screening; what is a fault of a channel is named beside the effects.
    """
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    answers = _once([*outcome.effects, *faults])
    verdict, sentence = verdict_and_sentence(outcome, answers, kinds)
    sentence += experiment_sentence(verdict, outcome.experiment)
    sentence += contradiction(verdict, outcome.gap)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence + closing_sentence(outcome.gap, outcome.measure),
        effects=tuple(answers),
        undecided=tuple(outcome.undecided) if verdict == "undecided" else (),
        experiment=outcome.experiment,
        nothing_probability=outcome.nothing_probability,
        moved=outcome.moved,
        where=outcome.where,
        when=outcome.when,
        findings=tuple(findings),
        gap=outcome.gap,
        chi2_per_datum=outcome.chi2_per_datum,
        residual_white=outcome.residual_white,
        white_p_value=outcome.white_p_value,
        nominal=given,
        refitted=outcome.refitted,
        augmented=outcome.augmented,
        traces=outcome.traces,
        spectra=outcome.spectra,
        surface=outcome.surface,
        notes=tuple(outcome.notes),
        measured_force=outcome.measured_force,
    )


def _once(answers: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Keep the first answer for each kind and place."""
    kept: dict[tuple[str, Place], NamedEffect] = {}
    for answer in answers:
        kept.setdefault((answer.effect.kind, answer.effect.place), answer)
    return list(kept.values())
