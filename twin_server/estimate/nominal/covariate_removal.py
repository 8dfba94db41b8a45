"""Removes the effect of temperature and load from the readings of a twin of one mode."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from slowtime.evolution import learn_nominal
from slowtime_schemas.messages import Features
from twin_server.estimate.checkpoint import Checkpoint, NominalInUse
from twin_server.estimate.columns import Columns
from twin_server.estimate.covariates import (
    Condition,
    NotLearntError,
    Training,
    conclude,
    covariates_of,
    messages,
)
from twin_server.estimate.notices import Notice
from twin_server.history import states as st
from twin_server.registration.twin import Registration

from .learning import is_sane


class CorrectedReadings(NamedTuple):
    """Readings at the reference of the covariates, and the nominal values to compare them with.

    Parameters
    ----------
    frequency_hz, frequency_sd
        NaN where nothing can be said: in training, and where a covariate is missing.
    nominal
        Of each reading frequency, its relative sd, damping ratio, its relative sd; NaN in
        training.
    reasons
        Bits that stand against each.
    """

    frequency_hz: Float[np.ndarray, " time"]
    frequency_sd: Float[np.ndarray, " time"]
    nominal: Float[np.ndarray, "time 4"]
    reasons: Int[np.ndarray, " time"]
    checkpoint: Checkpoint
    notices: list[Notice]


def remove_covariates(
    registration: Registration,
    checkpoint: Checkpoint,
    features: Sequence[Features],
    given: Columns,
) -> CorrectedReadings:
    """Take the next readings of one twin, of which `given` holds the columns."""
    wanted = registration.covariates
    assert wanted is not None
    count = len(features)
    freed = CorrectedReadings(
        np.full(count, np.nan),
        np.full(count, np.nan),
        np.full((count, 4), np.nan),
        np.zeros(count, dtype=np.uint32),
        checkpoint,
        [],
    )
    # One reading after the other: sums over a whole batch would depend on where it was cut.
    for row, message in enumerate(features):
        reading = _Reading(
            float(given.slow_time[row]),
            float(given.frequency_hz[row]),
            float(given.frequency_sd[row]),
            float(given.frequency_sd[row] * given.learning_factor[row]),
            float(given.damping_ratio[row]),
            float(given.damping_sd[row] * given.learning_factor[row]),
            covariates_of(message, wanted),
            message.slow_time_unit,
        )
        if checkpoint.condition is None:
            freed.reasons[row] = st.TRAINING
            if not np.isfinite(reading.covariates).all():
                freed.reasons[row] |= st.NO_COVARIATE
            elif reading.is_sane:
                checkpoint = _train(checkpoint, reading, registration, row, freed.notices)
        else:
            checkpoint = _corrected(checkpoint, reading, registration, row, freed)
    return freed._replace(checkpoint=checkpoint)


class _Reading(NamedTuple):
    slow_time: float
    frequency: float
    sd: float
    learnt_sd: float
    damping: float
    damping_sd: float
    covariates: Float[np.ndarray, " covariate"]
    unit: str

    @property
    def is_sane(self) -> bool:
        return is_sane(self.frequency, self.learnt_sd)


def _train(
    checkpoint: Checkpoint,
    reading: _Reading,
    registration: Registration,
    row: int,
    notices: list[Notice],
) -> Checkpoint:
    """Add a reading to the training; the last one ends it."""
    wanted = registration.covariates
    assert wanted is not None
    sane = is_sane(reading.damping, reading.damping_sd)
    damping = (reading.damping, reading.damping_sd) if sane else (math.nan, math.nan)
    numbers = [
        reading.slow_time,
        reading.frequency,
        reading.learnt_sd,
        *damping,
        *reading.covariates,
    ]
    training = (checkpoint.training or Training()).added(np.array(numbers))
    if not training.is_enough(wanted):
        return dataclasses.replace(checkpoint, training=training)
    try:
        condition = conclude(training, wanted)
    except NotLearntError as error:
        notices.append(messages.not_learnt(row, None, str(error)))
        return dataclasses.replace(checkpoint, training=Training())
    notices.append(messages.learnt(row, condition, wanted, None))
    known = checkpoint.known or _known(training, condition)
    return dataclasses.replace(checkpoint, training=None, condition=condition, known=known)


def _known(training: Training, condition: Condition) -> NominalInUse:
    """Nominal model at the reference; damping is taken as if covariates did nothing to it."""
    nominal = learn_nominal(*condition.freed(training).T.copy())
    return NominalInUse(
        condition.frequency_hz,
        condition.law_sd,
        nominal.damping_ratio,
        nominal.damping_relative_sd,
    )


def _corrected(
    checkpoint: Checkpoint,
    reading: _Reading,
    registration: Registration,
    row: int,
    into: CorrectedReadings,
) -> Checkpoint:
    """Remove the effect of covariates from a reading, and test the residual for changes."""
    condition, known, wanted = checkpoint.condition, checkpoint.known, registration.covariates
    assert condition is not None
    assert known is not None
    assert wanted is not None
    removed = condition.remove(reading.covariates)
    into.reasons[row] = removed.reasons
    into.frequency_hz[row] = removed.factor * reading.frequency
    own = removed.own_sd * reading.frequency
    into.frequency_sd[row] = removed.factor * math.hypot(reading.sd, own)
    into.nominal[row] = (
        known.frequency_hz,
        _nominal_sd(registration, removed.law_sd, removed.difference_sd),
        known.damping_ratio,
        known.damping_relative_sd,
    )
    if removed.reasons or not reading.is_sane:
        return checkpoint
    condition, verdict = condition.judge(
        reading.slow_time, reading.frequency, reading.learnt_sd, reading.covariates, wanted
    )
    if verdict is not None:
        into.notices.append(messages.entered(row, verdict, registration, None, reading.unit))
    return dataclasses.replace(checkpoint, condition=condition)


def _nominal_sd(registration: Registration, law_sd: float, difference_sd: float) -> float:
    """Return the standard deviation of the nominal value that a reading is compared with."""
    nominal = registration.nominal
    if nominal is None:
        return law_sd
    return math.hypot(nominal.frequency_relative_sd, difference_sd)
