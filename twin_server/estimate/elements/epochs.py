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
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, ndtri

from slowtime.evolution import Reason
from slowtime.evolution.structures import (
    MeasuredModes,
    StructurePosterior,
    estimate,
    name_changes,
)
from slowtime.evolution.structures.measured_modes import mode_misfit
from slowtime_schemas.messages import Features
from twin_server.estimate.covariates import Removed, Verdict, covariates_of
from twin_server.estimate.elements.memory import Baseline, ElementMemory, ReadingPool
from twin_server.history import states as st
from twin_server.registration.assessing import Assessing
from twin_server.registration.nominal import Covariates
from twin_server.registration.structure import ElementModel

from .assessment import compare, groups_of
from .baseline_learning import conclude, gather, is_enough
from .compared_modes import Nominal, freed, measured_now
from .mode_matching import match, update_reference
from .observed_modes import ObservedMode, observed_modes
from .pooled_modes import added
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
    assessed
        Latest comparison of the members with the reference, as JSON has it.
    """

    features: Features
    seen: tuple[ObservedMode, ...]
    pairs: dict[int, int]
    reasons: int
    changes: Float[np.ndarray, "parameter 4"] | None = None
    ratio: Float[np.ndarray, " parameter"] | None = None
    suspects: tuple[SuspectGroup, ...] = ()
    assessed: dict[str, Any] | None = None


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
    assessing: Assessing | None = None,
) -> TrackedEpochs:
    """Take in the next epochs of one twin.

    Parameters
    ----------
    wanted
        Covariates to be learnt and taken out; learning lasts as long as they say then.
    covered
        Share of the time of each that earlier windows have measured [1]; empty for none. What
        was measured wholly before is estimated, and nothing is learnt from it.
    assessing
        How members are compared with the reference; None to name changes reading by reading.
    """
    readings, lessons, verdicts = [], [], []
    nominal = Nominal.of(memory, model) if memory.knows else None
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
                nominal = Nominal.of(memory, model) if memory.knows else None
            continue
        pairs = match(memory.references, modes, message.boot)
        references = tuple(
            update_reference(one, modes[pairs[i]] if i in pairs else None, message.boot)
            for i, one in enumerate(memory.references)
        )
        memory = dataclasses.replace(memory, references=references)
        removed = _removed(message, nominal, wanted)
        reading = _read(message, modes, pairs, nominal, removed, alone=assessing is None)
        if assessing is not None:
            if new:
                memory = _assessed(memory, reading, nominal, removed, assessing)
            told = memory.assessed
            reading = dataclasses.replace(reading, suspects=groups_of(told), assessed=told)
        readings.append(reading)
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
    nominal, modes = Nominal.of(memory, model), observed_modes(message, model)
    pairs = match(memory.references, modes, message.boot)
    removed = _removed(message, nominal, wanted)
    if not pairs or any(one.reasons & st.NO_COVARIATE for one in removed):
        return None
    matched = [(nominal.baselines[i], i, modes[j]) for i, j in sorted(pairs.items())]
    measured = measured_now(matched, nominal, removed)
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
    message: Features, nominal: "Nominal", wanted: Covariates | None
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


def _read(
    message: Features,
    modes: Sequence[ObservedMode],
    pairs: dict[int, int],
    nominal: Nominal,
    removed: Sequence[Removed],
    *,
    alone: bool,
) -> EpochEstimate:
    """Estimate the changes of one epoch, and name them by it `alone`."""
    numbers = {modes[j].place: nominal.baselines[i].mode for i, j in sorted(pairs.items())}
    if not pairs:
        reasons = st.NO_MODEL_MODE if modes else st.NO_MODE
        return EpochEstimate(message, tuple(modes), numbers, reasons)
    against = functools.reduce(operator.or_, (one.reasons for one in removed), 0)
    if against & st.NO_COVARIATE:
        return EpochEstimate(message, tuple(modes), numbers, against)
    matched = [(nominal.baselines[i], i, modes[j]) for i, j in sorted(pairs.items())]
    measured = measured_now(matched, nominal, removed)
    posterior = estimate(nominal.structure, measured, nominal.model.prior_sd, starts=STARTS)
    changes = _changes(posterior)
    if changes is None:
        return EpochEstimate(message, tuple(modes), numbers, st.NOT_REPRESENTABLE)
    reasons = against | (st.MODEL_MISFIT if posterior.p_value < MISFIT else 0)
    away = [abs(freed(mode, i, removed)[0] / o.frequency_hz - 1.0) for o, i, mode in matched]
    if max(away) >= _FAR:
        reasons |= int(Reason.BEYOND_RECOMMENDED)
    return EpochEstimate(
        message,
        tuple(modes),
        numbers,
        reasons,
        changes,
        posterior.ratio,
        _suspects(measured, nominal) if alone else (),
    )


def _assessed(
    memory: ElementMemory,
    reading: EpochEstimate,
    nominal: Nominal,
    removed: Sequence[Removed],
    assessing: Assessing,
) -> ElementMemory:
    """Add a reading to those that wait, and compare them once they are enough.

    Readings under covariates that training has not seen are left out: their law is a guess.
    """
    if reading.changes is None or reading.reasons & st.BEYOND_COVARIATES:
        return memory
    places = {mode.place: j for j, mode in enumerate(reading.seen)}
    numbers = {one.mode: i for i, one in enumerate(nominal.baselines)}
    pairs = {numbers[number]: places[at] for at, number in reading.pairs.items()}
    message = reading.features
    pool = added(memory.pool, reading.seen, pairs, nominal, removed, message.t_ns)
    if pool.readings < assessing.readings:
        return dataclasses.replace(memory, pool=pool)
    found = compare(pool, nominal, assessing, memory.learnt_from)
    waiting = ReadingPool(compared_ns=pool.until_ns)
    return dataclasses.replace(memory, pool=waiting, assessed=found or memory.assessed)


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


def _suspects(measured: MeasuredModes, nominal: Nominal) -> tuple[SuspectGroup, ...]:
    """Name the elements that have changed, if "no change" does not explain the modes."""
    structure, prior = nominal.structure, nominal.model.prior_sd
    still = mode_misfit(structure, measured, np.zeros(len(prior)), prior)
    shapes = 0 if measured.shapes is None else int(np.isfinite(measured.shapes).any(1).sum())
    free = max(len(still.residual) - shapes, 1)
    if chdtrc(free, float(still.residual @ still.residual)) > UNCHANGED:
        return ()
    named = name_changes(structure, measured, changed_sd=prior, most=_MOST_CHANGED)
    return suspects_of(named)
