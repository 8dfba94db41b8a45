"""Assembly of the diagnosis: verdict, sentences, the gap on what was not fitted, pictures."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy.stats

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.data.screening import Finding, screen
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Gap,
    NamedEffect,
    Number,
    Rival,
    Step,
    Surface,
    Suspect,
    Verdict,
    When,
)
from slowtime.discrepancy.estimation.candidate_fit import misfit
from slowtime.discrepancy.estimation.input_hold import saying_holds, told_of_holds
from slowtime.discrepancy.experiment_design.proposal import propose_experiment
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization, characterise
from slowtime.discrepancy.noise import Noise, has_rigid_motion
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of, renumbered, requoted_by_place
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.force_surface import AUTO, SurfaceDemand
from slowtime.discrepancy.refinement.free_run_refit import (
    FreeRunRefit,
    refit_plainly_on_heads,
    refit_to_free_runs,
)
from slowtime.discrepancy.selection.doubts import doubt_laws, doubt_pieces
from slowtime.discrepancy.selection.inadequacy import (
    MAX_AMPLITUDE_LEFT,
    law_probability,
    temper_unexplained,
)
from slowtime.discrepancy.selection.many_laws import pieces_of_one, temper_many_laws
from slowtime.discrepancy.selection.probabilities import (
    MAX_LOCAL_MINIMUM_REST,
    fault_of,
    verdict_of,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import (
    FreeRunResult,
    evaluate_free_run,
    evaluation_trials,
    noise_floor_error,
    noise_of_runs,
    refit_on_heads,
    spectra_of,
    traces_of,
)
from slowtime.discrepancy.validation.holdout import is_confirmed_on_holdout
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Friction, Kind, Place, force_along

from .gap_closure import ClosedGap, close_gap, describe_gap_closure
from .likeness import OWN_CLOCK, Likeness, likenesses
from .surface_cuts import measured_force

MAX_REST_HERE = 1e-3
"""[share of what was missing at first] That is left at the place of an effect at most, if its
law is right. Source: judgement; no study is recorded."""
MAX_REST_ELSEWHERE = 0.05
"""[share of what was missing at first] That is left at another place at most, if the effects
stand. Source: judgement; no study is recorded."""
NOISE_ERROR_RATIO = 1.01
"""[1] Of the error on a held-out record to that of noise alone, up to which the record is
explained. Source: judgement; no study is recorded."""
MIN_LAW_PROBABILITY = 0.5
"""[probability] Of laws compared in all combinations, below which the effect is unknown.
Source: even odds."""
MAX_CONSTANT_RATIO = 3.0
"""[1] Of a fitted mass or stiffness to the stated one, either way, beyond which the model is
another structure's. Source: judgement; drawings are off by tens of per cent."""
SINGLE_LAW_ERROR_SHARE = 0.1
"""[share of the error of the refitted model] To which one law must reduce it, where noise is so
low that no law explains the record within it. Source: judgement; no study is recorded."""
UNEXPLAINED_SHARE = 0.5
"""[share of what was missing at first] Above which what was named does not tell where to look.
Source: judgement; no study is recorded."""
FALLEN_ERROR_SHARE = 0.9
"""[1] Of an error to the one before, up to which it has fallen; of the noise floor to an error,
from which the floor is reached. Source: judgement; no study is recorded."""
CLOCK_ERROR_SHARE = 0.5
"""[1] The same of a law with a clock of its own, for it to be called near. Source: a
decision."""

NOT_HELD_OUT = (
    "No record was held out: the error is that on the last third of each record, of a "
    "model fitted to the rest. Hold a record out to see how well the model predicts "
    "other conditions."
)
NEARER = (
    " Narrower tolerances of the constants, or a record at another excitation level, would "
    "decide."
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
FLOATS = (
    "No element connects the structure to the base, so the model can move as a rigid "
    "body. If the structure is attached to the ground, connect a node to `base`."
)
NOT_KEPT = (
    "On the held-out record, the original model has a smaller error than the fitted one: "
    "it is kept unchanged."
)
NO_SURFACE = (
    "No force surface was fitted: what is missing is a link or an unmeasured motion, not a "
    "force in an element of the model."
)
HURRIED = "The computing budget ran out before every law was tried; raise it with --patience."


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evaluation:
    """Free runs of the models on records that were not fitted.

    Parameters
    ----------
    tests
        Records that were held out, or the last third of each record.
    held_out
        Whether they were held out.
    nominal
        Of the model as given.
    steps
        Of the refitted model, and of the model after each effect.
    noise
        Of the tests, estimated from what the last model leaves.
    floor
        Relative error of that noise alone [1].
    """

    tests: tuple[Trial, ...]
    held_out: bool
    nominal: FreeRunResult
    steps: tuple[FreeRunResult, ...]
    noise: Noise
    floor: float

    @property
    def errors(self) -> list[float]:
        """Relative error of each step [1], the mean over its sensors."""
        return [float(step.error.mean()) for step in self.steps]

    @property
    def last_is_worse(self) -> bool:
        """Whether the last model does worse on held-out records than the model as given."""
        return self.held_out and self.errors[-1] > float(self.nominal.error.mean())


def report(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    found: Hypothesis,
    kinds: Mapping[str, Kind],
    monitor: Monitor | None = None,
    *,
    surface: SurfaceDemand = AUTO,
) -> Diagnosis:
    """Put a diagnosis together: verdict, sentences, error of free runs, and data of plots.

    Parameters
    ----------
    campaign
        Model and records.
    trials
        Screened records that were fitted.
    findings
        What screening found out about channels.
    found
        Hypothesis with which the search ended.
    kinds
        Catalogue of effects by name.
    monitor
        Of the budget; where given, and the effect is unknown, a force surface closes the gap.
    surface
        Shape that this is to have.
    """
    given = campaign.description
    evaluation = _evaluate(campaign, trials, found, kinds)
    judged = _judge(given, found, evaluation, findings, kinds)
    kept = _kept_model(judged, evaluation, trials, kinds, monitor, surface)
    judged = _requoted(judged, kept, given, evaluation, kinds)
    found, verdict, sentence = judged.found, judged.verdict, judged.sentence
    closed = kept.closed
    like = [] if closed is None else likenesses(closed.fit, closed.place, found, kinds)
    last, located = found.last, found.localized
    assert located is not None
    doubted = bool(found.pair) and not judged.unknown
    experiment = propose_experiment(found.pair or (), trials, kinds) if doubted else None
    if experiment is not None:
        sentence += f" Experiment that would decide: {experiment.sentence}"
    white_p_value = chi2_p_value(last)
    named = found.effects or judged.unknown
    return Diagnosis(
        verdict=verdict,
        sentence=sentence + _closing(kept.result, evaluation),
        effects=judged.answers,
        undecided=found.undecided if verdict == "undecided" else (),
        experiment=experiment,
        nothing_probability=_nothing(found, located),
        moved={} if kept.useless else _moved(kept, last, given),
        where=_suspects(located),
        when=_when(located, given.unit_of_coordinate) if found.effects else When((), (), ""),
        findings=findings,
        gap=_gap(found, evaluation, kept.result, kept.closed),
        chi2_per_datum=last.chi2_per_datum,
        residual_white=white_p_value > LIMITS.white_p_value,
        white_p_value=white_p_value,
        nominal=given,
        refitted=_described(found.first),
        augmented=given if kept.useless else saying_holds(_described(kept.fit)),
        traces=traces_of(
            evaluation.tests, evaluation.nominal.runs, evaluation.steps[0].runs,
            kept.result.runs,
        ),
        spectra=spectra_of(
            evaluation.tests, evaluation.steps[0].runs, kept.result.runs, evaluation.noise
        ),
        surface=_surface(found, kinds, unknown=judged.unknown) if named else None,
        notes=_notes(given, judged, kept, evaluation, kinds, like),
        measured_force=None if closed is None else measured_force(closed, like, found, kinds),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judgement:
    """Verdict on a hypothesis, after its free runs on records that were not fitted.

    Parameters
    ----------
    found
        The hypothesis, with the doubts that arose.
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


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeptModel:
    """The model that is adopted, and its free run on what was not fitted.

    Parameters
    ----------
    closed
        A force surface that closes the gap, where the effect is unknown and one does.
    why_open
        Why none does.
    useless
        Whether the model as given does better than the fitted one, and is kept.
    refitted
        The refit of its constants to the plain error of free runs, where that is adopted.
    """

    fit: Fit
    result: FreeRunResult
    closed: ClosedGap | None
    why_open: str | None
    useless: bool
    refitted: FreeRunRefit | None = None


def _judge(
    given: Description,
    found: Hypothesis,
    evaluation: Evaluation,
    findings: Sequence[Finding],
    kinds: Mapping[str, Kind],
) -> Judgement:
    found = _doubted(found, evaluation, kinds)
    unknown = _is_unknown(found, evaluation, kinds)
    found = found if unknown else _near_unknown(found)
    answers = _answers(given, found, () if unknown else found.effects, findings, kinds)
    nearest = _nearest(found, evaluation, kinds)
    verdict, sentence = _verdict_and_sentence(
        given, found, answers, nearest, kinds, unknown=unknown
    )
    return Judgement(
        found=found, unknown=unknown, answers=tuple(answers), verdict=verdict,
        sentence=sentence,
    )  # fmt: skip


def _kept_model(
    judged: Judgement,
    evaluation: Evaluation,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    monitor: Monitor | None,
    surface: SurfaceDemand,
) -> KeptModel:
    """Close the gap by a force surface where the effect is unknown, or keep what there is."""
    found, unknown = judged.found, judged.unknown
    # Constants that were distorted to imitate an unknown effect do not make a better model.
    useless = unknown and evaluation.last_is_worse
    result = evaluation.nominal if useless else evaluation.steps[-1]
    closed = (
        _closed(found, trials, evaluation, result, kinds, monitor, surface)
        if unknown and monitor
        else None
    )
    if isinstance(closed, ClosedGap):
        return KeptModel(
            fit=closed.fit, result=closed.result, closed=closed, why_open=None, useless=False
        )
    kept = KeptModel(
        fit=found.last, result=result, closed=None, why_open=closed, useless=useless
    )
    if useless or monitor is None:
        return kept
    return _refitted_to_free_runs(kept, found, evaluation, trials, monitor)


def _refitted_to_free_runs(
    kept: KeptModel,
    found: Hypothesis,
    evaluation: Evaluation,
    trials: tuple[Trial, ...],
    monitor: Monitor,
) -> KeptModel:
    """Refit the constants of a model with effects to free runs, where that predicts better."""
    if not found.effects or found.final or not found.last_fits_whole_records:
        return kept

    def tell() -> None:
        monitor("refitting constants to free runs", 0.97)

    refitted = refit_to_free_runs(found.last, trials, tell)
    if refitted is None:
        return kept
    fit = refitted.fit
    ahead = fit if evaluation.held_out else refit_plainly_on_heads(fit, trials)
    result = evaluate_free_run(_described(ahead), ahead, evaluation.tests)
    return dataclasses.replace(kept, fit=fit, result=result, refitted=refitted)


def _requoted(
    judged: Judgement,
    kept: KeptModel,
    given: Description,
    evaluation: Evaluation,
    kinds: Mapping[str, Kind],
) -> Judgement:
    """Quote the parameters of the model that is kept, the verdict being what it is."""
    if kept.refitted is None:
        return judged
    effects = requoted_by_place(judged.found.effects, kept.fit, kinds)
    found = dataclasses.replace(judged.found, effects=tuple(effects))
    answers = requoted_by_place(judged.answers, kept.fit, kinds)
    nearest = _nearest(found, evaluation, kinds)
    _, sentence = _verdict_and_sentence(
        given, found, answers, nearest, kinds, unknown=judged.unknown
    )
    return dataclasses.replace(judged, found=found, answers=tuple(answers), sentence=sentence)


def _moved(kept: KeptModel, last: Fit, given: Description) -> dict[str, Number]:
    """Give constants of the model that left their tolerance, with the values that are kept."""
    fit = last if kept.refitted is None else kept.refitted.fit
    return moved_of(fit) | renumbered(fit, given)


def _note_on_refit(refitted: FreeRunRefit, last: Fit, error: float, after: float) -> str:
    """Say which constants the refit to free runs has changed, and what that gains.

    Parameters
    ----------
    error, after
        Of free runs on what was not fitted, before and after [1].
    """
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
        f"error falls by {share:.0f} %; on the validation data, from {_percent(error)} to "
        f"{_percent(after)}."
    )


def _notes(
    given: Description,
    judged: Judgement,
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
    if judged.verdict == "nothing_missing":
        notes += _far(found.last)
    if found.combined and not _holds_laws(found):
        notes.append(LITTLE)
    return (*notes, *_note_on_noise(found, evaluation, kinds, unknown=unknown))


def _closed(
    found: Hypothesis,
    trials: tuple[Trial, ...],
    evaluation: Evaluation,
    kept: FreeRunResult,
    kinds: Mapping[str, Kind],
    monitor: Monitor,
    surface: SurfaceDemand,
) -> ClosedGap | str:
    """Close the gap by a force surface, where that does better on what was not fitted."""
    if found.final or found.link is not None:
        return NO_SURFACE
    monitor("measuring the force surface", 0.94)
    return close_gap(
        found,
        trials,
        evaluation.tests,
        kinds,
        held_out=evaluation.held_out,
        error=float(kept.error.mean()),
        demand=surface,
    )


def _evaluate(
    campaign: Campaign, trials: tuple[Trial, ...], found: Hypothesis, kinds: Mapping[str, Kind]
) -> Evaluation:
    """Simulate the model as given, refitted, and after each effect, on what was not fitted."""
    given, first, held_out = campaign.description, found.first, bool(campaign.holdout)
    channels = tuple(sensor.channel for sensor in given.sensors)
    tests = evaluation_trials(trials, tuple(screen(t).trial for t in campaign.holdout))
    # A fast clock claims samples after the end of the record, which no model can predict.
    tests = mask_clock_overrun(
        tests, channels, (answer.effect for answer in found.effects), kinds
    )
    as_given = dataclasses.replace(first, values=first.plant.values)
    nominal = evaluate_free_run(given, as_given, tests)
    ahead = found.fits if held_out else [refit_on_heads(fit, trials) for fit in found.fits]
    steps = tuple(evaluate_free_run(_described(fit), fit, tests) for fit in ahead)
    noise = noise_of_runs(found.last, tests, steps[-1].runs)
    return Evaluation(
        tests=tests,
        held_out=held_out,
        nominal=nominal,
        steps=steps,
        noise=noise,
        floor=noise_floor_error(tests, noise),
    )


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


def _is_unknown(found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]) -> bool:
    """Whether something is missing that is none of the effects known here."""
    if found.combined:
        # Sets of simple laws are right or wrong by what they leave, however exact the sensor.
        return _holds_laws(found) and law_probability(found) < MIN_LAW_PROBABILITY
    if found.refuted_at is not None or found.link is not None:
        return True
    # Which of two it is matters once one of them could be right.
    doubted = bool(found.undecided) and found.last.chi2_in_band < LIMITS.far_off_chi2
    explained = doubted or _foretold(found, evaluation, kinds) or _loud(found, evaluation)
    return not explained and _leaves_more(found, kinds)


def _holds_laws(found: Hypothesis) -> bool:
    """Whether a law of the structure was found, not only offsets of channels."""
    return any(answer.effect.place.kind == "element" for answer in found.effects)


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
        yield from (f"Nearest: {a.sentence}" for a in _nearest(found, evaluation, kinds))
        return
    yield from _pieced(found, kinds)
    yield from _as_well(found, kinds)
    yield from _besides(found)


def _nearest(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind]
) -> tuple[NamedEffect, ...]:
    """Give the effects with which the error on what was not fitted falls noticeably.

    A law with a clock of its own describes a stationary gap badly: it has to take half of it.
    """
    errors = evaluation.errors
    if len(errors) != len(found.effects) + 1:
        return found.effects
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


def _note_on_noise(
    found: Hypothesis, evaluation: Evaluation, kinds: Mapping[str, Kind], *, unknown: bool
) -> Iterator[str]:
    """Tell of noise of another colour, where that keeps what is left from being unknown."""
    if not unknown and _loud(found, evaluation) and _leaves_more(found, kinds):
        yield LOUD


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


def _loud(found: Hypothesis, evaluation: Evaluation) -> bool:
    """Whether nothing was found, and what was not fitted is met as well as noise allows.

    What is left is then noise of another colour than it was taken to have.
    """
    little = found.fits[-1].chi2_in_band < WRONG_MODEL_CHI2
    within = FALLEN_ERROR_SHARE * evaluation.errors[-1] <= evaluation.floor
    return not found.effects and little and within


def _leaves_more(found: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
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
    return _still_left(found) > (most if here else MAX_REST_ELSEWHERE)


def _still_left(found: Hypothesis) -> float:
    """Share of what was missing at first that still is, beyond one and the same noise."""
    first, last = found.fits[0], found.fits[-1]
    counts = [[len(r) for r in fit.residual] for fit in (first, last)]
    if counts[0] != counts[1]:
        assert found.localized is not None
        assert found.rest is not None
        return found.rest.groups[0].score / found.localized.groups[0].score
    before, after = (misfit(fit, last.noise, found.trials) - last.data for fit in (first, last))
    return max(after, 0.0) / max(before, 1.0)


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
    share = _still_left(found)
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
        name: min(1.0, 2 * len(pulls) * float(scipy.stats.norm.sf(abs(pull))))
        for name, pull in pulls.items()
    }
    return tuple(
        f"The {name[0]} of {name[1]} had to be changed by {abs(pulls[name]):.1f} times "
        "its tolerance. This is allowed, but the probability that any constant is so far "
        f"off is {_percent(chance)}."
        for name, chance in chances.items()
        if chance < IMPROBABLE_PULL
    )


def _once(answers: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Keep the first answer for each kind and place."""
    kept: dict[tuple[str, Place], NamedEffect] = {}
    for answer in answers:
        kept.setdefault((answer.effect.kind, answer.effect.place), answer)
    return list(kept.values())


def _described(fit: Fit) -> Description:
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return with_values(fit.plant.description, values)


def _verdict_and_sentence(
    given: Description,
    found: Hypothesis,
    answers: Sequence[NamedEffect],
    nearest: Sequence[NamedEffect],
    kinds: Mapping[str, Kind],
    *,
    unknown: bool,
) -> tuple[Verdict, str]:
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
    if found.link is not None:
        return (
            f"Something is missing for which the model has no element: {found.link} "
            "explains more than any effect in slowtime's catalogue. If such a link may "
            "exist, add it to the model and diagnose again."
            + (f" The nearest effect is {near}." if near else "")
        )
    place, but = found.refuted_at, "follows another curve"
    if place is None:
        # What was named without explaining much tells nothing of where to look.
        first, rest = found.localized, found.rest
        assert first is not None
        assert rest is not None
        far = _still_left(found) > UNEXPLAINED_SHARE
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


def _closing(kept: FreeRunResult, evaluation: Evaluation) -> str:
    """Say how far the gap has closed, and how near it is to the noise."""
    before, after = float(evaluation.nominal.error.mean()), float(kept.error.mean())
    floor = evaluation.floor
    on = "the held-out record" if evaluation.held_out else "the last third of the records"
    fell = after < FALLEN_ERROR_SHARE * before
    opening = "With the updated model, the error" if fell else "The error"
    course = f"falls from {_percent(before)} to" if fell else "is"
    close = after <= floor / FALLEN_ERROR_SHARE
    rest = ", the noise floor." if close else f"; noise alone would give {_percent(floor)}."
    return f" {opening} on {on} {course} {_percent(after)}{rest}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _nothing(found: Hypothesis, located: Localization) -> float:
    if found.effects:
        return float(np.exp(-max(located.groups[0].score, 0.0)))
    return 1.0 - min(0.5, max(0.0, 1e-3 - located.p_value))


def _suspects(located: Localization) -> tuple[Suspect, ...]:
    return tuple(
        Suspect(place, g.score, g.p_value, g.share)
        for g in located.groups
        for place in g.places
    )


def _when(located: Localization, coordinate: str) -> When:
    seen = characterise(located, located.best)
    motion = "an elongation" if located.best.kind == "element" else "a displacement"
    return When(
        seen.times_s, seen.bands_hz, seen.amplitude(motion, coordinate), linear=seen.linear,
        steady=seen.steady,
    )  # fmt: skip


def _gap(
    found: Hypothesis, evaluation: Evaluation, kept: FreeRunResult, closed: ClosedGap | None
) -> Gap:
    refitted, *errors = evaluation.errors
    steps = [
        Step(answer.effect.kind, answer.effect.place, error)
        for answer, error in zip(found.effects, errors, strict=False)
    ]
    if closed is not None:
        steps.append(Step(closed.fit.plant.effects[-1].kind, closed.place, closed.error))
    return Gap(
        nominal=float(evaluation.nominal.error.mean()),
        refitted_nominal=refitted,
        steps=tuple(steps),
        augmented=float(kept.error.mean()),
        noise_floor=evaluation.floor,
        on="holdout" if evaluation.held_out else "tail",
        worst=float(kept.error.max()),
    )


def _surface(found: Hypothesis, kinds: Mapping[str, Kind], *, unknown: bool) -> Surface | None:
    """Force at the place of the first effect, or of none, as recovered before any was in."""
    located, refuted = found.localized, found.refuted_at
    assert located is not None
    answers = () if unknown else found.effects
    place = answers[0].effect.place if answers else refuted or located.best_structural
    if place.kind not in ("element", "node"):
        return None
    latents = [located.latent(place, i) for i in range(len(located.trials))]
    law = None
    if answers:
        kind, parameters = kinds[answers[0].effect.kind], answers[0].effect.parameters
        law = np.concatenate([force_along(kind, parameters, x.motion) for x in latents])
    stride = max(sum(len(x.force) for x in latents) // 5000, 1)
    return Surface(
        place=place,
        e=np.concatenate([x.motion.e for x in latents])[::stride],
        v=np.concatenate([x.motion.v for x in latents])[::stride],
        force=np.concatenate([x.force for x in latents])[::stride],
        law=None if law is None else law[::stride],
    )
