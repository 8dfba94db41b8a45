"""Notes of a diagnosis: what limits it, and what else may hold."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.special import ndtr

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.diagnosis import Number
from slowtime.discrepancy.estimation.input_hold import told_of_holds
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.quoting import percent
from slowtime.discrepancy.refinement.free_run_refit import FreeRunRefit
from slowtime.discrepancy.selection.many_laws import pieces_of_one
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

from .evaluation import Evaluation
from .explanation import (
    holds_laws,
    is_only_noise_left,
    leaves_too_much,
    nearest_effects,
    share_left,
)
from .final_model import KeptModel, moved_constants
from .gap_closure import describe_gap_closure
from .judgement import JudgedHypothesis
from .likeness import Likeness

NOT_HELD_OUT = (
    "No record was held out: the error is that on the last third of each record, of a "
    "model fitted to the rest. Hold a record out to see how well the model predicts "
    "other conditions."
)
LITTLE = (
    "The model leaves a residual above the sensor noise, but below 2 % of the motion, "
    "and no law of stiffness or damping explains it significantly. It is not reported as "
    "an effect."
)
LOUD = (
    "The residual does not have the spectrum that was assumed for the noise, but the error on "
    "records that were not fitted is no larger than the noise. It is taken to be noise."
)
EQUIVALENT_CHI2 = 9.0
"""[1] Chi squared that a law may leave more than another and explain as much. Source:
three-sigma rule for one parameter."""
IMPROBABLE_PULL = 0.05
"""[probability] That any constant is as far within its tolerance, below which it is reported.
Source: the 5 % level."""
NEGATIVE_SDS = 2.0
"""[standard deviations] Below zero, from which a damping constant is called negative. Source:
two-sigma rule."""
FLOATS = (
    "No element connects the structure to the base, so the model can move as a rigid "
    "body. If the structure is attached to the ground, connect a node to `base`."
)
NOT_KEPT = (
    "On the held-out record, the original model has a smaller error than the fitted one: "
    "it is kept unchanged."
)
HURRIED = "The computing budget ran out before every law was tried; raise it with --patience."


def notes_of(
    given: Description,
    judged: JudgedHypothesis,
    kept: KeptModel,
    evaluation: Evaluation,
    kinds: Mapping[str, Kind],
    like: Sequence[Likeness],
) -> tuple[str, ...]:
    """Collect what limits the diagnosis."""
    found, unknown = judged.found, judged.unknown
    notes = [*_notes_on_records(given, evaluation, useless=kept.useless)]
    if found.exhausted:
        notes.append(HURRIED)
    notes += _notes_on_effects(found, evaluation, kinds, unknown=unknown)
    if kept.closed is not None:
        notes.append(describe_gap_closure(kept.closed, evaluation.errors[0], like, kinds))
    if kept.why_open is not None:
        notes.append(kept.why_open)
    if kept.refitted is not None:
        after = float(kept.result.error.mean())
        notes.append(_note_on_refit(kept.refitted, found.last, evaluation.errors[-1], after))
    lacks_nothing = not (unknown or found.effects or found.undecided)
    if lacks_nothing and not moved_constants(kept, given):
        notes += _far(found.last)
    if found.combined and not holds_laws(found):
        notes.append(LITTLE)
    if not kept.useless:
        notes += _negative_damping(kept.fit)
    # Noise of another colour keeps what is left from being unknown.
    if not unknown and is_only_noise_left(found, evaluation) and leaves_too_much(found, kinds):
        notes.append(LOUD)
    return tuple(notes)


def _note_on_refit(refitted: FreeRunRefit, last: Fit, error: float, after: float) -> str:
    """Say which constants the refit to free runs has changed, and what that gains."""
    before = dict(zip(last.prior.names, last.free.tolist(), strict=True))
    told = ", ".join(
        f"{' '.join(map(str, name[2:] or name))} {before[name]:.4g} → {value:.4g}"
        for name, value in zip(
            refitted.fit.prior.names, refitted.fit.free.tolist(), strict=True
        )
    )
    share = 100 * (1 - np.exp(-refitted.gain))
    return (
        "Constants of the final model were refitted to minimise the error of free-run "
        f"simulations: {told}. On parts of the records that this refit did not use, the "
        f"error falls by {share:.0f} %; on the validation data, from {percent(error)} to "
        f"{percent(after)}. An effect is quoted by its estimate before, unless refits without "
        "parts of the records agree on another number."
    )


def _notes_on_records(
    given: Description, evaluation: Evaluation, *, useless: bool
) -> Iterator[str]:
    """Tell what limits the comparison of the model with its records."""
    if not evaluation.held_out:
        yield NOT_HELD_OUT
    if useless:
        yield NOT_KEPT
    yield from told_of_holds(given)
    if has_rigid_motion(given):
        yield FLOATS


def _notes_on_effects(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind], *, unknown: bool
) -> Iterator[str]:
    """Tell which effects come nearest to an unknown one, or what else those found may be."""
    if unknown:
        yield from (f"Nearest: {a.sentence}" for a in nearest_effects(found, evaluation, kinds))
        return
    yield from _pieced(found, kinds)
    yield from _as_well(found, kinds)
    yield from _besides(found)


def _besides(found: Hypothesis) -> tuple[str, ...]:
    """Say of structure that is left, where it is, and how little beside what was found."""
    if (
        not found.effects
        or found.rest is None
        or found.rest.p_value > LIMITS.false_alarm_p_value
    ):
        return ()
    if chi2_p_value(found.fits[-1]) > LIMITS.coloured_p_value:
        return ()
    rest = found.rest.groups[0]
    share = share_left(found)
    return (
        "The remaining residual is not only noise: part of it points to "
        f"{rest.places[0]}, and it is {100 * share:.2g} % of the initial discrepancy.",
    )


def _pieced(found: Hypothesis, kinds: Mapping[str, Kind]) -> tuple[str, ...]:
    """Say of two curves at one place that they may be one that is not known."""
    return tuple(
        f"The two laws over the {variable} at {place} may together imitate one law that "
        "is not in slowtime's catalogue."
        for place, variable in pieces_of_one(found.effects, kinds).items()
    )


def _as_well(found: Hypothesis, kinds: Mapping[str, Kind]) -> tuple[str, ...]:
    """Say which laws of more numbers do as well as the only one that was named."""
    if len(found.effects) != 1 or len(found.fits) != 2 or found.undecided or found.final:
        return ()
    (answer,), best = found.effects, found.fits[-1]
    others = {
        one.effect.kind: one
        for one in (*found.nested, *found.fitted)
        if one.effect.place == answer.effect.place and one.effect.kind != answer.effect.kind
        and len(one.fit.states) == len(found.trials)
    }  # fmt: skip
    least = misfit(best, best.noise, found.trials)
    return tuple(
        f"{kinds[name].words} at {answer.effect.place}, a law with more parameters, would "
        "fit equally well: these records do not show the difference."
        for name, one in others.items()
        if len(kinds[name].names) > len(answer.effect.parameters)
        and misfit(one.fit, best.noise, found.trials) < least + EQUIVALENT_CHI2
    )


def _far(fit: Fit) -> tuple[str, ...]:
    """Tell of constants that kept within their tolerance, and are far off all the same."""
    pulls = fit.constant_pulls
    chances = {
        name: min(1.0, 2 * len(pulls) * float(ndtr(-abs(pull)))) for name, pull in pulls.items()
    }
    return tuple(
        f"The {name[0]} of {name[1]} had to be changed by {abs(pulls[name]):.1f} times "
        "its tolerance. This is allowed, but the probability that any constant is so far "
        f"off is {percent(chance)}."
        for name, chance in chances.items()
        if chance < IMPROBABLE_PULL
    )


def _negative_damping(fit: Fit) -> tuple[str, ...]:
    """Tell of dampers that feed energy in the fitted model, though the stated ones do not."""
    stated = fit.plant.entries
    return tuple(
        f"In the updated model, the damping of {name[1]} is negative "
        f"({Number(value, sd, stated[name].unit).text}). Together with the other laws it "
        "describes the records; beyond the motion in them, the model may gain energy."
        for name, value, sd in zip(
            fit.prior.names, fit.free.tolist(), fit.inflated_sd.tolist(), strict=True
        )
        if name[0] == "damping" and stated[name].value >= 0 and value < -NEGATIVE_SDS * sd
    )
