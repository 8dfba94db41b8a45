"""Verdict and sentence of a diagnosis."""

from collections.abc import Callable, Sequence

from slowtime.discrepancy.diagnosis import Experiment, Gap, NamedEffect, Rival, Verdict
from slowtime.discrepancy.selection.probabilities import verdict_of

from .explanation import FALLEN_ERROR_SHARE
from .outcome import NOTHING, ErrorMeasure, Outcome

CONTRADICTED_RATIO = 5.0
"""[1] Error on held-out records over that of noise alone, from which they contradict a model
that lacks nothing. Source: constants that are fitted to short records make twice the noise."""
CONTRADICTED_ERROR = 0.05
"""[share of the motion] Of the same error at least. Source: docs/what_decides.md: half and
double change no answer."""
CONTRADICTED = (
    " But the held-out record contradicts the model: something acts there that the fitted "
    "records do not show, such as an effect of larger motion. Fit that record too, and hold "
    "out another."
)
NEARER = (
    " Narrower tolerances of the constants, or a record at another excitation level, would "
    "decide."
)


def verdict_and_sentence(
    outcome: Outcome, answers: Sequence[NamedEffect], words: Callable[[Rival], str]
) -> tuple[Verdict, str]:
    """Give the verdict, and say it to people; the parameters are those of `answered`."""
    if outcome.unknown:
        return "unknown_effect", outcome.unknown
    if outcome.undecided:
        return "undecided", _undecided(outcome, words)
    if answers:
        return verdict_of(answers), " ".join(a.sentence for a in answers)
    if outcome.moved:
        told = ", ".join(f"{name} = {n.text}" for name, n in outcome.moved.items())
        return (
            "parameters_only",
            f"No effect is missing, but constants are outside their tolerances: {told}.",
        )
    return "nothing_missing", outcome.nothing


def _undecided(outcome: Outcome, words: Callable[[Rival], str]) -> str:
    rivals: Sequence[Rival] = outcome.undecided
    together = len(rivals) > 1 and len(rivals) == len(outcome.effects)
    together &= {(r.effect, r.place) for r in rivals} == {
        (a.effect.kind, a.effect.place) for a in outcome.effects
    }
    word = " together with " if together else " or "
    names = word.join("nothing" if r.effect == NOTHING else words(r) for r in rivals)
    names += ", or only wrong constants of the model" if outcome.constants_suffice else ""
    names += (
        ", or a similar law that is not in slowtime's catalogue" if outcome.near_unknown else ""
    )
    lead = "Something is missing, but these records do not identify it uniquely."
    if any(r.effect == NOTHING for r in rivals):
        lead = "These records do not tell whether something is missing."
    told = f"{lead} Possible explanations: {names}."
    return told + (NEARER if outcome.near_unknown else "")


def experiment_sentence(verdict: Verdict, experiment: Experiment | None) -> str:
    """Say what to measure next."""
    if experiment is None:
        return ""
    lead = "Experiment that would decide: " if verdict == "undecided" else ""
    return f" {lead}{experiment.sentence}"


def contradiction(verdict: Verdict, gap: Gap) -> str:
    """Say that a model which lacks nothing misses held-out records by far more than noise."""
    error = gap.augmented
    missed = error > CONTRADICTED_RATIO * gap.noise_floor and error > CONTRADICTED_ERROR
    lacks_nothing = verdict in ("nothing_missing", "parameters_only")
    return CONTRADICTED if lacks_nothing and gap.on == "holdout" and missed else ""


def closing_sentence(gap: Gap, measure: ErrorMeasure) -> str:
    """Say how far the gap has closed, and how near it is to the noise."""
    before, after, floor = gap.nominal, gap.augmented, gap.noise_floor
    on = "the held-out record" if gap.on == "holdout" else "the last third of the records"
    fell = after < FALLEN_ERROR_SHARE * before
    opening = "With the updated model, the error" if fell else "The error"
    course = f"falls from {measure.text(before)} to" if fell else "is"
    close = after <= floor / FALLEN_ERROR_SHARE
    rest = f", {measure.reached}." if close else f"; {measure.alone} {measure.text(floor)}."
    return f" {opening}{measure.of} on {on} {course} {measure.text(after)}{rest}"
