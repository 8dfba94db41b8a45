"""Judgement of a hypothesis, with the doubts that held-out records raise."""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.diagnosis import NamedEffect, Rival
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.doubts import doubt_laws, doubt_pieces
from slowtime.discrepancy.selection.inadequacy import (
    MAX_AMPLITUDE_LEFT,
    law_probability,
    temper_unexplained,
)
from slowtime.discrepancy.selection.many_laws import temper_many_laws
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.holdout import is_confirmed_on_holdout
from slowtime.dynamics.effects import Kind

from .evaluation import Evaluation
from .explanation import is_unknown, nearest_effects, share_left

MAX_CONSTANT_RATIO = 3.0
"""[1] Of a fitted mass or stiffness to the stated one, either way, beyond which the model is
another structure's. Source: drawings are off by tens of per cent."""
UNEXPLAINED_REST = 0.5
"""[share of what was missing at first] Above which what was named does not tell where to look.
Source: docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JudgedHypothesis:
    """A hypothesis after its free runs on records that were not fitted.

    Parameters
    ----------
    unknown
        Whether something is missing that is none of the effects known here.
    effects
        That are named, each with its probability; none where what is missing is unknown.
    """

    found: Hypothesis
    unknown: bool
    effects: tuple[NamedEffect, ...]


def judge(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]
) -> JudgedHypothesis:
    """Judge a hypothesis by what it leaves, and by records that were not fitted."""
    found = _doubted(found, evaluation, kinds)
    unknown = is_unknown(found, evaluation, kinds)
    found = found if unknown else _near_unknown(found)
    effects = _tempered(found, () if unknown else found.effects, kinds)
    return JudgedHypothesis(found=found, unknown=unknown, effects=effects)


def unknown_sentence(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]
) -> str:
    """Say where something is missing that no effect known here explains."""
    near = " together with ".join(
        f"{kinds[a.effect.kind].words} at {a.effect.place}"
        for a in nearest_effects(found, evaluation, kinds)
    )
    place, but = found.refuted_at, "follows another curve"
    if place is None:
        # What was named without explaining much tells nothing of where to look.
        first, rest = found.localized, found.rest
        assert first is not None
        assert rest is not None
        far = share_left(found) > UNEXPLAINED_REST
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


def _tempered(
    found: Hypothesis, effects: Sequence[NamedEffect], kinds: Mapping[str, Kind]
) -> tuple[NamedEffect, ...]:
    """Hold effects for less sure where they are many, or leave much."""
    assert found.localized is not None
    alike = bool(found.localized.groups[0].twins)
    several = temper_many_laws(effects, len(found.fits) - 1, kinds, alike=alike)
    return temper_unexplained(several, found)
