r"""Changes of a twin's parameters, epoch by epoch, from its modes.

What is compared with the model is what has changed since learning,

.. math:: \ln f_j - \ln f_j^0 + \ln f_j(\theta_0), \qquad
          \phi_j - \phi_j^0 + \phi_j(\theta_0) ,

with :math:`f^0, \phi^0` as learnt and :math:`f(\theta_0), \phi(\theta_0)` of the model moved
there, so that what the model cannot explain even then is not taken for a change. The errors of
what was learnt are added to those of each epoch, which are widened where the readings scattered
more than they said from epoch to epoch while learning.

Under covariates each frequency is first brought to their reference, by a law of its own. What
those laws leave is taken to be independent from mode to mode, which a temperature that no
sensor sees is not: it moves all of them alike, and looks like all elements changing alike.
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, ndtri

from slowtime.evolution import Reason
from slowtime.evolution.structures import (
    MeasuredModes,
    ParametricStructure,
    StructurePosterior,
    estimate,
    name_changes,
)
from slowtime.evolution.structures.measured_modes import mode_misfit
from slowtime_schemas.messages import Features
from twin_server.estimate.covariates import Removed, Verdict, covariates_of
from twin_server.estimate.elements.memory import Baseline, ElementMemory
from twin_server.history import states as st
from twin_server.registration.nominal import Covariates
from twin_server.registration.structure import ElementModel

from .baseline_learning import common_patterns, conclude, gather, is_enough
from .mode_matching import aligned, match, update_reference
from .observed_modes import ObservedMode, observed_modes
from .suspects import SuspectGroup, suspects_of

STARTS = 2
"""Searches besides the one from nominal, for the posterior may have several peaks."""

UNCHANGED = 0.01
"""Probability of data as far from "nothing has changed", below which suspects are sought."""

MISFIT = 1e-5
"""Probability of data as far from the best parameters, below which none of them explains it."""

QUANTILE = float(ndtri(0.975))
"""Half of a 95 % interval, in standard deviations."""

_MOST_CHANGED = 2
"""Parameters that one hypothesis lets change at most."""

_FAR = 0.3
"""Relative shift of a frequency from which estimates are beyond the recommended range [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class EpochEstimate:
    """Estimates of one epoch.

    Parameters
    ----------
    features
        The message.
    seen
        Its structural modes.
    pairs
        Place of a mode in the message → its number in the model.
    reasons
        Bits that stand against it; 0 where nothing does.
    changes
        Of each free parameter value, sd, lo and hi; None where nothing could be estimated.
    ratio
        Posterior over prior sd of each.
    suspects
        What has changed.
    """

    features: Features
    seen: tuple[ObservedMode, ...]
    pairs: dict[int, int]
    reasons: int
    changes: Float[np.ndarray, "parameter 4"] | None = None
    ratio: Float[np.ndarray, " parameter"] | None = None
    suspects: tuple[SuspectGroup, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class TrackedEpochs:
    """Estimates of some epochs, and the memory after them.

    Parameters
    ----------
    lessons
        Epochs that ended the learning, and how many modes of the model it had found: none
        where it begins anew.
    verdicts
        Epochs in which covariates no longer explained a mode of that number, or did again.
    """

    memory: ElementMemory
    readings: tuple[EpochEstimate, ...]
    lessons: tuple[tuple[int, int], ...]
    verdicts: tuple[tuple[int, int, Verdict], ...] = ()


def track_epochs(
    memory: ElementMemory,
    model: ElementModel,
    features: Sequence[Features],
    learn_epochs: int,
    wanted: Covariates | None = None,
    covered: Sequence[float] = (),
) -> TrackedEpochs:
    """Take in the next epochs of one twin.

    Parameters
    ----------
    wanted
        Covariates to be learnt and taken out; learning lasts as long as they say then.
    covered
        Share of the time of each that earlier windows have measured [1]; empty for none. What
        was measured wholly before is estimated, and nothing is learnt from it.
    """
    readings, lessons, verdicts = [], [], []
    nominal = _Nominal.of(memory, model) if memory.knows else None
    for row, message in enumerate(features):
        modes = observed_modes(message, model)
        new = not covered or not st.is_measured_before(covered[row])
        if nominal is None:
            if new:
                memory, reasons = _taught(memory, message, modes, wanted)
            else:
                reasons = st.LEARNING if wanted is None else st.TRAINING
            readings.append(EpochEstimate(message, tuple(modes), {}, reasons))
            if is_enough(memory, learn_epochs, wanted):
                memory = conclude(memory, model, wanted)
                lessons.append((row, len(memory.baselines)))
                nominal = _Nominal.of(memory, model) if memory.knows else None
            continue
        pairs = match(memory.references, modes, message.boot)
        references = tuple(
            update_reference(one, modes[pairs[i]] if i in pairs else None, message.boot)
            for i, one in enumerate(memory.references)
        )
        memory = dataclasses.replace(memory, references=references)
        removed = _removed(message, nominal, wanted)
        readings.append(_read(message, modes, pairs, nominal, removed))
        if wanted is not None and new:
            baselines, judged = _watched(memory, message, modes, pairs, wanted)
            memory = dataclasses.replace(memory, baselines=baselines)
            verdicts += [(row, mode, verdict) for mode, verdict in judged]
    return TrackedEpochs(memory, tuple(readings), tuple(lessons), tuple(verdicts))


def posterior_of(
    memory: ElementMemory,
    model: ElementModel,
    message: Features,
    wanted: Covariates | None = None,
) -> Float[np.ndarray, "parameter parameter"] | None:
    """Covariance of the logarithms of the free factors, from one epoch.

    None where it tells nothing.
    """
    nominal, modes = _Nominal.of(memory, model), observed_modes(message, model)
    pairs = match(memory.references, modes, message.boot)
    removed = _removed(message, nominal, wanted)
    if not pairs or any(one.reasons & st.NO_COVARIATE for one in removed):
        return None
    matched = [(nominal.baselines[i], i, modes[j]) for i, j in sorted(pairs.items())]
    measured = _measured(matched, nominal, removed)
    return estimate(nominal.structure, measured, model.prior_sd, starts=STARTS).covariance


def _taught(
    memory: ElementMemory,
    message: Features,
    modes: Sequence[ObservedMode],
    wanted: Covariates | None,
) -> tuple[ElementMemory, int]:
    """Learn from an epoch; also the bits that stand against it."""
    nothing = 0 if modes else st.NO_MODE
    if wanted is None:
        return gather(memory, modes, message.boot), st.LEARNING | nothing
    covariates = covariates_of(message, wanted)
    if not np.isfinite(covariates).all():
        return memory, st.TRAINING | st.NO_COVARIATE | nothing
    told = covariates.tolist()
    memory = gather(memory, modes, message.boot, message.slow_time, told)
    return memory, st.TRAINING | nothing


def _removed(
    message: Features, nominal: "_Nominal", wanted: Covariates | None
) -> tuple[Removed, ...]:
    """For each baseline, the effect of covariates on its frequency; none without covariates."""
    if wanted is None:
        return ()
    covariates = covariates_of(message, wanted)
    return tuple(
        one.condition.remove(covariates)
        for one in nominal.baselines
        if one.condition is not None
    )


def _watched(
    memory: ElementMemory,
    message: Features,
    modes: Sequence[ObservedMode],
    pairs: dict[int, int],
    wanted: Covariates,
) -> tuple[tuple[Baseline, ...], list[tuple[int, Verdict]]]:
    """Judge the frequency of each mode that was found."""
    baselines, verdicts = list(memory.baselines), []
    covariates = covariates_of(message, wanted)
    for i, j in sorted(pairs.items()):
        condition, mode = baselines[i].condition, modes[j]
        assert condition is not None
        sd = mode.relative_sd * mode.frequency_hz
        condition, verdict = condition.judge(
            message.slow_time, mode.frequency_hz, sd, covariates, wanted
        )
        baselines[i] = dataclasses.replace(baselines[i], condition=condition)
        if verdict is not None:
            verdicts.append((baselines[i].mode, verdict))
    return tuple(baselines), verdicts


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Nominal:
    """The structure at learning, and the modes that the model gives it."""

    model: ElementModel
    structure: ParametricStructure
    baselines: tuple[Baseline, ...]
    frequency_hz: Float[np.ndarray, " baseline"]
    shapes: Float[np.ndarray, "baseline channel"]
    shape_error: Float[np.ndarray, " baseline"]

    @classmethod
    def of(cls, memory: ElementMemory, model: ElementModel) -> "_Nominal":
        structure = model.at(memory.theta)
        modes = structure.modes(np.zeros(len(structure.names)))
        which = [one.mode for one in memory.baselines]
        shapes = (model.rows @ modes.shape[:, which]).T
        frequency_hz = modes.frequency_hz[which]
        learnt_hz = np.array([one.frequency_hz for one in memory.baselines])
        error = _shape_error(learnt_hz, frequency_hz)
        return cls(model, structure, memory.baselines, frequency_hz, shapes, error)


def _shape_error(
    learnt_hz: Float[np.ndarray, " mode"], model_hz: Float[np.ndarray, " mode"]
) -> np.ndarray:
    """Error of the changes of shapes that a model gives, over these changes [1].

    Modes turn towards each other by what couples them over the difference of their
    eigenvalues (first order), so that the turn is as wrong as this difference, at most wholly.
    """
    error = np.log(learnt_hz / model_hz)
    apart = np.abs(np.log(model_hz / model_hz[:, None]))
    np.fill_diagonal(apart, np.inf)
    wrong = np.abs(error - error[:, None]) / np.maximum(apart, 1e-12)
    return np.asarray(np.minimum(wrong.max(axis=1), 1.0))


def _read(
    message: Features,
    modes: Sequence[ObservedMode],
    pairs: dict[int, int],
    nominal: _Nominal,
    removed: Sequence[Removed],
) -> EpochEstimate:
    numbers = {modes[j].place: nominal.baselines[i].mode for i, j in sorted(pairs.items())}
    if not pairs:
        reasons = st.NO_MODEL_MODE if modes else st.NO_MODE
        return EpochEstimate(message, tuple(modes), numbers, reasons)
    against = functools.reduce(operator.or_, (one.reasons for one in removed), 0)
    if against & st.NO_COVARIATE:
        return EpochEstimate(message, tuple(modes), numbers, against)
    matched = [(nominal.baselines[i], i, modes[j]) for i, j in sorted(pairs.items())]
    measured = _measured(matched, nominal, removed)
    posterior = estimate(nominal.structure, measured, nominal.model.prior_sd, starts=STARTS)
    changes = _changes(posterior)
    if changes is None:
        return EpochEstimate(message, tuple(modes), numbers, st.NOT_REPRESENTABLE)
    reasons = against | (st.MODEL_MISFIT if posterior.p_value < MISFIT else 0)
    away = [abs(_freed(mode, i, removed)[0] / o.frequency_hz - 1.0) for o, i, mode in matched]
    if max(away) >= _FAR:
        reasons |= int(Reason.BEYOND_RECOMMENDED)
    return EpochEstimate(
        message,
        tuple(modes),
        numbers,
        reasons,
        changes,
        posterior.ratio,
        _suspects(measured, nominal),
    )


def _freed(mode: ObservedMode, i: int, removed: Sequence[Removed]) -> tuple[float, float]:
    """Frequency at the reference of the covariates, and the relative sd that this adds."""
    if not removed:
        return mode.frequency_hz, 0.0
    one = removed[i]
    return one.factor * mode.frequency_hz, math.hypot(one.own_sd, one.law_sd)


def _measured(
    matched: Sequence[tuple[Baseline, int, ObservedMode]],
    nominal: _Nominal,
    removed: Sequence[Removed],
) -> MeasuredModes:
    frequency, relative, shapes, shape_sds, moves = [], [], [], [], []
    for baseline, i, mode in matched:
        freed, added = _freed(mode, i, removed)
        frequency.append(freed / baseline.frequency_hz * float(nominal.frequency_hz[i]))
        own = baseline.scatter * mode.relative_sd
        relative.append(math.hypot(own, added if removed else baseline.relative_sd))
        shape, shape_sd, move = _shape(baseline, mode, nominal.shapes[i])
        shapes.append(shape)
        shape_sds.append(shape_sd)
        moves.append(nominal.shape_error[i] * move)
    values, any_shape = np.array(frequency), bool(np.isfinite(shapes).any())
    known = [baseline for baseline, _, _ in matched]
    return MeasuredModes(
        frequency_hz=values,
        frequency_sd_hz=values * np.array(relative),
        shapes=np.array(shapes) if any_shape else None,
        shape_sd=np.array(shape_sds) if any_shape else None,
        channels=nominal.model.rows if any_shape else None,
        shape_common=_common(known, np.array(shape_sds), np.array(moves))
        if any_shape
        else None,
    )


def _common(
    baselines: Sequence[Baseline],
    shape_sd: Float[np.ndarray, "mode channel"],
    moves: Float[np.ndarray, "mode channel"],
) -> Float[np.ndarray, "mode pattern channel"]:
    """Patterns in which the channels of each shape err together, in the unit of the shape.

    Those of what was learnt, and the error of the model in the change of each shape.
    """
    learnt = common_patterns(baselines, shape_sd)
    own = np.nan_to_num(moves)[:, None]
    return own if learnt is None else np.concatenate([learnt, own], axis=1)


def _shape(
    baseline: Baseline, mode: ObservedMode, model: Float[np.ndarray, " channel"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape of the model plus its change since learning; NaN where not measured.

    Returns
    -------
    Shape, its standard deviation, and the change, by channel [channel].
    """
    nothing = np.full(len(model), np.nan)
    if mode.shape is None or mode.shape_sd is None or baseline.shape is None:
        return nothing, nothing, nothing
    learnt, learnt_sd = np.array(baseline.shape), np.array(baseline.shape_sd)
    now, factor = aligned(mode.shape, learnt)
    own, _ = aligned(model, learnt)
    sd = np.hypot(baseline.shape_scatter * factor * mode.shape_sd, learnt_sd)
    shape = own + now - learnt
    known = np.isfinite(shape) & np.isfinite(sd)
    if known.sum() < 2:
        return nothing, nothing, nothing
    shape, sd, move = (np.where(known, one, np.nan) for one in (shape, sd, now - learnt))
    return shape, sd, move


def _changes(posterior: StructurePosterior) -> Float[np.ndarray, "parameter 4"] | None:
    """Value, sd, lo and hi of the relative changes, over all peaks of the posterior."""
    theta, sd = posterior.theta, posterior.sd
    half = QUANTILE * sd
    with np.errstate(over="ignore", invalid="ignore"):
        numbers = np.column_stack(
            (
                np.expm1(theta),
                np.exp(theta) * sd,
                np.expm1(theta - half),
                np.expm1(theta + half),
            )
        )
    return numbers if np.isfinite(numbers).all() else None


def _suspects(measured: MeasuredModes, nominal: _Nominal) -> tuple[SuspectGroup, ...]:
    """Name the elements that have changed, if "no change" does not explain the modes."""
    structure, prior = nominal.structure, nominal.model.prior_sd
    still = mode_misfit(structure, measured, np.zeros(len(prior)), prior)
    shapes = 0 if measured.shapes is None else int(np.isfinite(measured.shapes).any(1).sum())
    free = max(len(still.residual) - shapes, 1)
    if chdtrc(free, float(still.residual @ still.residual)) > UNCHANGED:
        return ()
    named = name_changes(structure, measured, changed_sd=prior, most=_MOST_CHANGED)
    return suspects_of(named)
