"""Verdict and sentence of a diagnosis."""

from collections.abc import Mapping, Sequence

from slowtime.discrepancy.diagnosis import NamedEffect, Verdict
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.quoting import moved_of, percent, renumbered
from slowtime.discrepancy.selection.probabilities import verdict_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import FreeRunResult
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

from .evaluation import Evaluation
from .explanation import FALLEN_ERROR_SHARE, share_left

MAX_CONSTANT_RATIO = 3.0
"""[1] Of a fitted mass or stiffness to the stated one, either way, beyond which the model is
another structure's. Source: judgement; drawings are off by tens of per cent."""
UNEXPLAINED_SHARE = 0.5
"""[share of what was missing at first] Above which what was named does not tell where to look.
Source: judgement; no study is recorded."""
CONTRADICTED_RATIO = 5.0
"""[1] Error on held-out records over that of noise alone, from which they contradict a model
that lacks nothing. Source: judgement; constants that are fitted to short records make twice the
noise."""
CONTRADICTED_ERROR = 0.05
"""[share of the motion] Of the same error at least. Source: judgement."""
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
    given: Description,
    found: Hypothesis,
    answers: Sequence[NamedEffect],
    nearest: Sequence[NamedEffect],
    kinds: Mapping[str, Kind],
    *,
    unknown: bool,
) -> tuple[Verdict, str]:
    """Give the verdict, and say it to people.

    Parameters
    ----------
    unknown
        Whether something is missing that is none of the effects known here.
    """
    if unknown:
        return "unknown_effect", _unnamed(found, nearest, kinds)
    if found.undecided:
        together = len(found.undecided) > 1 and len(found.undecided) == len(found.effects)
        together &= {(r.effect, r.place) for r in found.undecided} == {
            (a.effect.kind, a.effect.place) for a in found.effects
        }
        word = " together with " if together else " or "
        names = word.join(f"{kinds[r.effect].words} at {r.place}" for r in found.undecided)
        names += ", or only wrong constants of the model" if found.constants_suffice else ""
        names += (
            ", or a similar law that is not in slowtime's catalogue"
            if found.near_unknown
            else ""
        )
        told = (
            "Something is missing, but these records do not identify it uniquely. Possible "
            f"explanations: {names}."
        )
        return "undecided", told + (NEARER if found.near_unknown else "")
    if answers:
        return verdict_of(answers, kinds), " ".join(a.sentence for a in answers)
    moved = moved_of(found.fits[0]) | renumbered(found.fits[0], given)
    if moved:
        told = ", ".join(f"{name} = {n.text}" for name, n in moved.items())
        return (
            "parameters_only",
            f"No effect is missing, but constants are outside their tolerances: {told}.",
        )
    return "nothing_missing", "Nothing is missing beyond the stated tolerances."


def _unnamed(
    found: Hypothesis, nearest: Sequence[NamedEffect], kinds: Mapping[str, Kind]
) -> str:
    near = " together with ".join(
        f"{kinds[a.effect.kind].words} at {a.effect.place}" for a in nearest
    )
    place, but = found.refuted_at, "follows another curve"
    if place is None:
        # What was named without explaining much tells nothing of where to look.
        first, rest = found.localized, found.rest
        assert first is not None
        assert rest is not None
        far = share_left(found) > UNEXPLAINED_SHARE
        place, but = (
            (first if far else rest).best_structural,
            "leaves a residual above the noise",
        )
        near = "" if far else near
    impossible = _impossible_constants(found)
    if impossible:
        return (
            f"The constants of the model cannot be those of the structure: {impossible}. "
            "Correct the model first; with these constants, neither the missing effect "
            "nor its place can be determined."
        )
    return (
        f"Something is missing at {place} that is not in slowtime's catalogue of effects. "
        "The report shows its force as reconstructed from the records."
        + (f" The nearest effect, {near}, {but}." if near else "")
    )


def _impossible_constants(found: Hypothesis) -> str:
    """Name the masses and stiffnesses that a refit moved by more than `MAX_CONSTANT_RATIO`."""
    last = found.last
    names = [name for name in last.prior.names if name[0] in ("mass", "stiffness")]
    told = []
    for name in names:
        at = last.prior.names.index(name)
        stated, fitted = float(last.prior.mean[at]), float(last.free[at])
        pull = abs(last.pulls.get(name, 0.0))
        ratio = fitted / stated if stated else 1.0
        if pull > LIMITS.moved_tolerances and not (
            1 / MAX_CONSTANT_RATIO < ratio < MAX_CONSTANT_RATIO
        ):
            unit = last.plant.entries[name].unit
            told.append(f"{name[0]} of {name[1]} {fitted:.3g} {unit}, stated {stated:.3g}")
    return "; ".join(told)


def contradiction(verdict: Verdict, last: FreeRunResult, evaluation: Evaluation) -> str:
    """Say that a model which lacks nothing misses held-out records by far more than noise."""
    error = float(last.error.mean())
    missed = error > CONTRADICTED_RATIO * evaluation.floor and error > CONTRADICTED_ERROR
    lacks_nothing = verdict in ("nothing_missing", "parameters_only")
    return CONTRADICTED if lacks_nothing and evaluation.held_out and missed else ""


def closing_sentence(kept: FreeRunResult, evaluation: Evaluation) -> str:
    """Say how far the gap has closed, and how near it is to the noise."""
    before, after = float(evaluation.nominal.error.mean()), float(kept.error.mean())
    floor = evaluation.floor
    on = "the held-out record" if evaluation.held_out else "the last third of the records"
    fell = after < FALLEN_ERROR_SHARE * before
    opening = "With the updated model, the error" if fell else "The error"
    course = f"falls from {percent(before)} to" if fell else "is"
    close = after <= floor / FALLEN_ERROR_SHARE
    rest = ", the noise floor." if close else f"; noise alone would give {percent(floor)}."
    return f" {opening} on {on} {course} {percent(after)}{rest}"
