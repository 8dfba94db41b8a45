"""Learns the baseline of each mode from the first epochs, and moves the model there."""

import contextlib
import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.evolution import learn_nominal
from slowtime.evolution.structures import MeasuredModes, estimate
from slowtime.evolution.structures.measured_modes import mode_misfit
from twin_server.estimate.covariates import Condition, NotLearntError, Training
from twin_server.estimate.covariates import conclude as conclude_training
from twin_server.estimate.elements.memory import Baseline, ElementMemory, ModeSamples, Reference
from twin_server.registration.nominal import Covariates
from twin_server.registration.structure import ElementModel

from .mode_matching import (
    aligned,
    best_pairs,
    channel_mac,
    match,
    new_reference,
    update_reference,
)
from .observed_modes import ObservedMode


@dataclasses.dataclass(frozen=True, slots=True)
class LearningLimits:
    """Thresholds of baseline learning; chosen, without a recorded study of their trade-off.

    Parameters
    ----------
    most_modes
        Modes that are gathered at most, which bounds memory.
    unmodelled_frequency
        Relative standard deviation of a frequency that no parameters of the model explain [1].
    unmodelled_shape
        Likewise of a component of a shape of norm 1 [1].
    shape_misfit
        1 - MAC a channel that costs 1/2 when learnt modes are paired with the model's [1].
    unlike_mac
        MAC below which a learnt mode is none of the model's [1].
    gate
        Cost at and above which a learnt mode is not paired with one of the model's [1].
    most_relative_sd
        Relative standard deviation of a frequency from which a mode is left out [1].
    clear_scatter
        Scatter over standard deviation above which the scatter counts [1].
    clear_common
        Square root of the ratio of the trace of the squared covariance to that of independent
        errors, above which errors are taken for correlated [1]; independent errors of 3 to 24
        channels stay below it in 95 % of simulated learnings of 4 to 40 epochs.
    most_steps
        Steps of a shape that are kept to tell common errors, which bounds memory.
    """

    most_modes: int = 64
    unmodelled_frequency: float = 0.002
    unmodelled_shape: float = 0.02
    shape_misfit: float = 0.1
    unlike_mac: float = 0.3
    gate: float = 10.0
    most_relative_sd: float = 0.1
    clear_scatter: float = 1.5
    clear_common: float = 1.3
    most_steps: int = 20


LIMITS = LearningLimits()


def gather(
    memory: ElementMemory,
    modes: Sequence[ObservedMode],
    boot: str,
    slow_time: float = 0.0,
    covariates: Sequence[float] | None = None,
) -> ElementMemory:
    """Add the modes of one epoch to those that are learnt from.

    Parameters
    ----------
    modes
        Modes of the epoch; without any, nothing changes.
    boot
        The edge's run, within which its names of modes last.
    slow_time
        Slow time of the epoch [unit of the boot].
    covariates
        Covariates of the epoch, each in its unit; None for a twin without.
    """
    if not modes:
        return memory
    pairs = match(memory.references, modes, boot)
    references, lessons = [], []
    for i, (reference, lesson) in enumerate(
        zip(memory.references, memory.lessons, strict=True)
    ):
        mode = modes[pairs[i]] if i in pairs else None
        references.append(update_reference(reference, mode, boot))
        lessons.append(
            lesson if mode is None else _added(lesson, mode, reference, slow_time, covariates)
        )
    fresh = [mode for j, mode in enumerate(modes) if j not in pairs.values()]
    for mode in fresh[: LIMITS.most_modes - len(references)]:
        references.append(new_reference(mode, boot))
        lessons.append(_added(ModeSamples(), mode, references[-1], slow_time, covariates))
    return dataclasses.replace(
        memory,
        references=tuple(references),
        lessons=tuple(lessons),
        learnt_from=memory.learnt_from + 1,
        since=min(memory.since, slow_time),
        until=max(memory.until, slow_time),
    )


def is_enough(memory: ElementMemory, learn_epochs: int, wanted: Covariates | None) -> bool:
    """Whether as many epochs were gathered as the registration asks for."""
    if wanted is None:
        return memory.learnt_from >= learn_epochs
    span = memory.until - memory.since
    return memory.learnt_from >= wanted.train_epochs and 0.0 < span >= wanted.train_span


def conclude(
    memory: ElementMemory, model: ElementModel, wanted: Covariates | None = None
) -> ElementMemory:
    """Make baselines of the gathered modes; if there are none, restart learning.

    Modes are left out where fewer than half of the epochs have shown them, where they match no
    mode of the model, or where no law of covariates can be learnt of them.
    """
    groups = []
    for reference, lesson in zip(memory.references, memory.lessons, strict=True):
        if lesson.count < max(2, memory.learnt_from / 2):
            continue
        with contextlib.suppress(NotLearntError):
            groups.append((reference, _baseline(lesson, wanted)))
    groups = [group for group in groups if group[1].relative_sd < LIMITS.most_relative_sd]
    pairs = _partners([baseline for _, baseline in groups], model)
    if not pairs:
        return ElementMemory(suspicions=memory.suspicions, unit_doubts=memory.unit_doubts)
    chosen = [groups[i] for i in pairs]
    theta, modes = _moved(model, [baseline for _, baseline in chosen])
    ranked = sorted(zip(modes, chosen, strict=True), key=lambda one: one[0])
    return dataclasses.replace(
        memory,
        references=tuple(reference for _, (reference, _) in ranked),
        lessons=(),
        theta=theta,
        baselines=tuple(
            dataclasses.replace(
                baseline, mode=mode, condition=_shared(baseline.condition, len(ranked))
            )
            for mode, (_, baseline) in ranked
        ),
    )


def _shared(condition: Condition | None, among: int) -> Condition | None:
    """Make false alarms of each mode so many times rarer as there are modes."""
    if condition is None:
        return None
    return dataclasses.replace(condition, limit=among * condition.limit)


def measured_of(
    baselines: Sequence[Baseline],
    model: ElementModel,
    *,
    unmodelled_frequency: float = 0.0,
    unmodelled_shape: float = 0.0,
) -> MeasuredModes:
    """Convert baselines to the measured modes that structures are estimated from.

    Parameters
    ----------
    unmodelled_frequency
        Relative standard deviation that is added to each frequency in quadrature [1].
    unmodelled_shape
        Standard deviation that is added to each component of a shape in quadrature [1].
    """
    frequency = np.array([one.frequency_hz for one in baselines])
    relative = np.array(
        [math.hypot(one.relative_sd, unmodelled_frequency) for one in baselines]
    )
    shapes = shape_sd = common = None
    if any(one.shape is not None for one in baselines):
        nothing = (math.nan,) * len(model.channels)
        shapes = np.array([one.shape or nothing for one in baselines])
        learnt_sd = np.array([one.shape_sd or nothing for one in baselines])
        shape_sd = np.hypot(learnt_sd, unmodelled_shape)
        common = common_patterns(baselines, learnt_sd)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=frequency * relative,
        shapes=shapes,
        shape_sd=shape_sd,
        channels=model.rows if shapes is not None else None,
        shape_common=common,
    )


def common_patterns(
    baselines: Sequence[Baseline], shape_sd: Float[np.ndarray, "mode channel"]
) -> Float[np.ndarray, "mode pattern channel"] | None:
    """Patterns of common errors of shapes, in their unit.

    Parameters
    ----------
    baselines
        What was learnt of each mode.
    shape_sd
        Standard deviations of the components of their shapes; NaN where not measured.

    Returns
    -------
    Patterns, 0 for modes with fewer; None without any.
    """
    most = max(len(one.shape_common) for one in baselines)
    if not most:
        return None
    patterns = np.zeros((len(baselines), most, shape_sd.shape[1]))
    for own, one in zip(patterns, baselines, strict=True):
        if one.shape_common:
            own[: len(one.shape_common)] = one.shape_common
    return np.asarray(patterns * np.nan_to_num(shape_sd)[:, None])


def _added(
    lesson: ModeSamples,
    mode: ObservedMode,
    reference: Reference,
    slow_time: float,
    covariates: Sequence[float] | None,
) -> ModeSamples:
    epoch = (
        mode.frequency_hz,
        mode.relative_sd * mode.frequency_hz,
        mode.damping_ratio,
        mode.damping_sd,
    )
    epochs, training = (*lesson.epochs, epoch), None
    if covariates is not None:
        row = np.array([slow_time, *epoch, *covariates])
        epochs, training = (), (lesson.training or Training()).added(row)
    if mode.shape is None or mode.shape_sd is None or reference.shape is None:
        return dataclasses.replace(lesson, epochs=epochs, training=training)
    turned, factor = aligned(mode.shape, np.array(reference.shape))
    sd = factor * mode.shape_sd
    precision = sd**-2.0
    known = np.isfinite(turned) & np.isfinite(precision)
    zeros = (0.0,) * len(turned)
    step = _step(lesson, turned, sd)
    both = np.isfinite(step)
    steps = lesson.steps
    if both.any():
        steps = (*steps, tuple(np.nan_to_num(step).tolist()))[-LIMITS.most_steps :]
    weight, heard = np.where(known, precision, 0.0), np.nan_to_num(turned)
    return ModeSamples(
        epochs,
        tuple((np.array(lesson.weighted or zeros) + weight * heard).tolist()),
        tuple((np.array(lesson.weight or zeros) + weight).tolist()),
        tuple(turned.tolist()),
        tuple(sd.tolist()),
        lesson.jumped + float((step[both] ** 2).sum()),
        # The size of one is fitted to the other, which takes one of the components along.
        lesson.jumps + max(int(both.sum()) - 1, 0),
        training,
        steps,
    )


def _step(
    lesson: ModeSamples, shape: Float[np.ndarray, " channel"], sd: Float[np.ndarray, " channel"]
) -> Float[np.ndarray, " channel"]:
    """Return the step from the shape before, over its standard deviation [1]; NaN where none.

    A structure that drifts while it is learnt hardly moves from one epoch to the next.
    """
    if not lesson.last:
        return np.full(len(shape), np.nan)
    last, last_sd = np.array(lesson.last), np.array(lesson.last_sd)
    turned, _ = aligned(shape, last)
    return np.asarray((turned - last) / np.hypot(sd, last_sd))


def common_errors(
    steps: Float[np.ndarray, "step channel"],
) -> Float[np.ndarray, "pattern channel"]:
    r"""Patterns of errors that channels have in common, from steps between shapes.

    Standard deviations of components say nothing of correlation. Shapes of ambient records err
    by parts of neighbouring modes, in all channels at once; along such a part an error is up to
    :math:`\sqrt{n}` times as probable as :math:`n` independent ones would make it. Of the
    sample covariance :math:`S`, shrunk towards :math:`\mu I`, what exceeds independent errors
    of variance 1 is kept: a pattern for each such direction.

    .. math:: (1 - \rho) S + \rho \mu I, \qquad \mu = \frac{\mathrm{tr} S}{n}, \qquad
              1 - \rho = \frac{\mathrm{tr} \Sigma^2 - n \mu^2}{\mathrm{tr} S^2 - n \mu^2}

    The trace of the squared covariance :math:`\Sigma` is that of the sample freed of its bias,
    m steps being worth :math:`2 m / 3` independent ones, since neighbouring steps share a
    shape.

    Parameters
    ----------
    steps
        Steps from one shape to the next, over their standard deviations [1].

    Returns
    -------
    Patterns in standard deviations [1]; none where errors are not clearly correlated.

    References
    ----------
    .. [1] O. Ledoit, M. Wolf, "Some hypothesis tests for the covariance matrix when the
       dimension is large compared to the sample size", Annals of Statistics 30 (2002).
    .. [2] O. Ledoit, M. Wolf, "A well-conditioned estimator for large-dimensional covariance
       matrices", Journal of Multivariate Analysis 88 (2004) 365-411.
    """
    count, channels = steps.shape
    none = np.zeros((0, channels))
    if count < 2 or channels < 2:
        return none
    inner = steps @ steps.T / count
    mean = float(np.trace(inner)) / channels
    if not mean > 0.0:
        return none
    white = channels * mean**2
    worth = count / _SHARED
    square = float((inner**2).sum())
    true = (square - channels * white / worth) * worth / (worth + 1.0)
    if true < LIMITS.clear_common**2 * white:
        return none
    kept = min((true - white) / (square - white), 1.0)
    _, size, patterns = np.linalg.svd(steps / math.sqrt(count), full_matrices=False)
    excess = kept * size**2 + (1.0 - kept) * mean - 1.0
    own = excess > 0.0
    return np.asarray(np.sqrt(excess[own])[:, None] * patterns[own])


_SHARED = 1.5
"""Sum of squared correlations of a step with all others [1]: 1 with itself, 1/4 with the one
before and the one after."""


def _baseline(lesson: ModeSamples, wanted: Covariates | None) -> Baseline:
    """Average the gathered readings of one mode; its number in the model is not known yet."""
    condition, epochs = None, np.array(lesson.epochs)
    if wanted is not None and lesson.training is not None:
        condition = conclude_training(lesson.training, wanted)
        epochs = condition.freed(lesson.training)
    frequency, sd, damping, damping_sd = epochs.T.copy()
    nominal = learn_nominal(frequency, sd, damping, damping_sd)
    weight = np.array(lesson.weight)
    shape = shape_sd = None
    shape_scatter, common = 1.0, np.zeros((0, len(weight)))
    if (weight > 0.0).sum() > 1:
        heard = weight > 0.0
        safe = np.where(heard, weight, 1.0)
        mean = np.where(heard, np.array(lesson.weighted) / safe, np.nan)
        norm = float(np.sqrt(np.nansum(mean**2)))
        shape_scatter = _scatter(math.sqrt(lesson.jumped / max(lesson.jumps, 1)))
        if lesson.steps:
            common = common_errors(np.array(lesson.steps) / shape_scatter)
        shape = tuple((mean / norm).tolist())
        shape_sd = tuple((shape_scatter * np.where(heard, safe**-0.5, np.nan) / norm).tolist())
    return Baseline(
        -1,
        nominal.frequency if condition is None else condition.frequency_hz,
        nominal.frequency_relative_sd if condition is None else condition.law_sd,
        nominal.damping_ratio,
        nominal.damping_relative_sd,
        shape,
        shape_sd,
        # What a law of covariates leaves is known by itself.
        _scatter(_steps(frequency, sd)) if condition is None else 1.0,
        shape_scatter,
        condition,
        tuple(map(tuple, common.tolist())),
    )


def _steps(frequency: Float[np.ndarray, " epoch"], sd: Float[np.ndarray, " epoch"]) -> float:
    """Return the robust scatter of steps between epochs over their standard deviation [1]."""
    far = np.diff(frequency) / np.hypot(sd[1:], sd[:-1])
    return 1.4826 * float(np.median(np.abs(far)))


def _scatter(ratio: float) -> float:
    """Return scatter over standard deviation where it is clearly above 1, else 1."""
    return ratio if ratio > LIMITS.clear_scatter else 1.0


def _partners(baselines: Sequence[Baseline], model: ElementModel) -> dict[int, int]:
    """Pair learnt modes with the model's, before the model is moved."""
    modes = model.whole.modes(np.zeros(len(model.whole.names)))
    reach = np.sqrt(np.sum((modes.log_frequency_slope * model.tolerance) ** 2, axis=1))
    gains = np.zeros((len(baselines), len(reach)))
    columns = model.rows @ modes.shape
    for i, one in enumerate(baselines):
        away = np.log(one.frequency_hz / modes.frequency_hz)
        cost = 0.5 * away**2 / ((reach + 0.01) ** 2 + one.relative_sd**2)
        if one.shape is not None:
            for j in range(len(reach)):
                alike, channels = channel_mac(np.array(one.shape), columns[:, j])
                own = max(channels - 1, 0)
                cost[j] += 0.5 * own * (1.0 - alike) / LIMITS.shape_misfit
                cost[j] += LIMITS.gate * (alike < LIMITS.unlike_mac and own > 0)
        gains[i] = LIMITS.gate - cost
    return dict(best_pairs(gains))


def _moved(
    model: ElementModel, baselines: Sequence[Baseline]
) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """Estimate the model's parameters, and the mode number of each baseline."""
    measured = measured_of(
        baselines,
        model,
        unmodelled_frequency=LIMITS.unmodelled_frequency,
        unmodelled_shape=LIMITS.unmodelled_shape,
    )
    theta = estimate(model.whole, measured, model.tolerance, starts=0).theta
    modes = mode_misfit(model.whole, measured, theta, np.full(len(theta), 0.05)).pairs
    return tuple(theta.tolist()), tuple(modes.tolist())
