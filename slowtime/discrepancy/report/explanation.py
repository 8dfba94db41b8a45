"""How much of what was missing a hypothesis explains, and what it leaves."""

from collections.abc import Mapping

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.inadequacy import law_probability
from slowtime.discrepancy.selection.probabilities import MAX_LOCAL_MINIMUM_REST
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Friction, Kind

from .evaluation import Evaluation
from .likeness import OWN_CLOCK

MAX_REST_HERE = 1e-3
"""[share of what was missing at first] That is left at the place of an effect at most, if its
law is right. Source: docs/what_decides.md: half and double change no answer."""
MAX_REST_ELSEWHERE = 0.05
"""[share of what was missing at first] That is left at another place at most, if the effects
stand. Source: docs/what_decides.md: half and double change no answer."""
NOISE_ERROR_RATIO = 1.01
"""[1] Of the error on a held-out record to that of noise alone, up to which the record is
explained. Source: docs/what_decides.md: half and double change no answer."""
MIN_LAW_PROBABILITY = 0.5
"""[probability] Of laws compared in all combinations, below which the effect is unknown.
Source: even odds."""
SINGLE_LAW_ERROR_SHARE = 0.1
"""[share of the error of the refitted model] To which one law must reduce it, where noise is so
low that no law explains the record within it. Source: docs/what_decides.md: half and double
change no answer."""
FALLEN_ERROR_SHARE = 0.9
"""[1] Of an error to the one before, up to which it has fallen; of the noise floor to an error,
from which the floor is reached. Source: docs/what_decides.md: half and double change no
answer."""
CLOCK_ERROR_SHARE = 0.5
"""[1] The same of a law with a clock of its own, for it to be called near. Source: a
decision."""


def is_unknown(found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]) -> bool:
    """Whether something is missing that is none of the effects known here."""
    if found.combined:
        # Sets of simple laws are right or wrong by what they leave, however exact the sensor.
        return holds_laws(found) and law_probability(found) < MIN_LAW_PROBABILITY
    if found.refuted_at is not None:
        return True
    # Which of two it is matters once one of them could be right.
    doubted = bool(found.undecided) and found.last.chi2_in_band < LIMITS.far_off_chi2
    explained = (
        doubted or _foretold(found, evaluation, kinds) or is_only_noise_left(found, evaluation)
    )
    return not explained and leaves_too_much(found, kinds)


def holds_laws(found: Hypothesis) -> bool:
    """Whether a law of the structure was found, not only offsets of channels."""
    return any(answer.effect.place.kind == "element" for answer in found.effects)


def nearest_effects(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]
) -> tuple[NamedEffect, ...]:
    """Give the effects with which the error on what was not fitted falls noticeably."""
    errors = evaluation.errors
    if len(errors) != len(found.effects) + 1:
        return found.effects
    # A law with a clock of its own describes a stationary gap badly: it has to take half of it.
    return tuple(
        answer
        for answer, before, after in zip(found.effects, errors, errors[1:], strict=False)
        if after
        < before
        * (
            CLOCK_ERROR_SHARE
            if kinds[answer.effect.kind].family in OWN_CLOCK
            else FALLEN_ERROR_SHARE
        )
    )


def _foretold(found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]) -> bool:
    """Whether held-out records are explained as by no law but the right one."""
    if not evaluation.held_out or not found.effects:
        return False
    errors = evaluation.errors
    inside = ("element", "node", "base")
    laws = [a for a in found.effects if kinds[a.effect.kind].where in inside]
    return errors[-1] <= NOISE_ERROR_RATIO * evaluation.floor or (
        len(laws) == 1 and errors[-1] <= SINGLE_LAW_ERROR_SHARE * errors[0]
    )


def is_only_noise_left(found: Hypothesis, evaluation: Evaluation) -> bool:
    """Whether nothing was found, and what was not fitted is met as well as noise allows."""
    # What is left is then noise, of another colour than was assumed.
    little = found.fits[-1].chi2_in_band < WRONG_MODEL_CHI2
    within = FALLEN_ERROR_SHARE * evaluation.errors[-1] <= evaluation.floor
    return not found.effects and little and within


def leaves_too_much(found: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Whether what is left is more than what was found, or nothing, could leave."""
    last = found.fits[-1]
    if not found.effects and last.chi2_in_band > WRONG_MODEL_CHI2:
        return True  # wherever it is
    if found.exhausted and not found.final and last.chi2_in_band > LIMITS.far_off_chi2:
        return True  # no right law leaves as much, and there was no time for others
    if found.rest is None or found.rest.p_value > LIMITS.false_alarm_p_value:
        return False
    if chi2_p_value(last) > LIMITS.coloured_p_value:
        return False
    if not found.effects:
        return True
    rest = found.rest.groups[0]
    here = [a for a in found.effects if a.effect.place in (*rest.places, *rest.twins)]
    sticks = any(isinstance(kinds[a.effect.kind].action, Friction) for a in here)
    most = MAX_LOCAL_MINIMUM_REST if sticks else MAX_REST_HERE
    return share_left(found) > (most if here else MAX_REST_ELSEWHERE)


def share_left(found: Hypothesis) -> float:
    """Share of what was missing at first that still is, beyond one and the same noise."""
    first, last = found.fits[0], found.fits[-1]
    counts = [[len(r) for r in fit.residual] for fit in (first, last)]
    if counts[0] != counts[1]:
        assert found.localized is not None
        assert found.rest is not None
        return found.rest.groups[0].score / found.localized.groups[0].score
    before, after = (misfit(fit, last.noise, found.trials) - last.data for fit in (first, last))
    return max(after, 0.0) / max(before, 1.0)
