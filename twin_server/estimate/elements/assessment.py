r"""Comparison of the present with the reference period, member by member, over time.

The mean modes of some readings are compared with what was learnt by
`slowtime.evolution.assessment`, with the errors of both, and of what covariates leave. The
comparison at the time t may raise a false alarm with probability

.. math:: \alpha = r \, (t - t')

with the accepted rate r and the time t' of the comparison before. The expected number of false
alarms in a year is the sum of these probabilities, and at most r however the comparisons depend
on each other: they share the reference (Boole's inequality).
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from slowtime.evolution.assessment import AssessmentSettings, assess
from slowtime.evolution.structures import MeasuredModes
from slowtime_services.assessment.entries import assessment_entry
from twin_server.registration.assessing import Assessing

from .compared_modes import ComparedMode, Nominal, compared_modes
from .memory import ReadingPool
from .pooled_modes import means
from .suspects import SuspectGroup, size

YEAR_NS = 365.25 * 86400e9
"""A year [ns]."""

MOST_PROBABLE, LEAST_PROBABLE = 0.05, 1e-12
"""Largest and smallest probability of a false alarm of one comparison [1]: after a long silence
no comparison is to be careless; below the smallest, tails of distributions mean nothing."""

_EXACT = 1e-6
"""Standard deviation of the model's own modes [1]: the errors of what was learnt are counted
among those of the present."""


def compare(
    pool: ReadingPool,
    nominal: Nominal,
    assessing: Assessing,
    learnt_from: int,
) -> dict[str, Any] | None:
    """Compare the mean of a pool of readings with what was learnt.

    Parameters
    ----------
    pool
        Readings since the comparison before.
    nominal
        The structure at learning.
    learnt_from
        Readings of the reference.

    Returns
    -------
    The assessment as JSON has it; None where no mode was seen in half of the readings.
    """
    errors = {
        "frequency_error": assessing.frequency_error,
        "shape_error": assessing.shape_error,
    }
    compared = means(pool, **errors)
    if not compared:
        return None
    level = _level(pool, assessing)
    settings = AssessmentSettings(
        model_error=assessing.model_error,
        temperature_sd=assessing.temperature_sd,
        false_alarm=level,
        most=assessing.most,
    )
    # Only stiffness may be lost; masses are not considered.
    structure = dataclasses.replace(nominal.structure, mass_parts=None, node_names=())
    now = compared_modes(compared, nominal)
    found = assess(structure, _reference(compared, nominal, now), now, settings)
    entry = assessment_entry(found, dict.fromkeys(structure.names, "member"))
    entry.pop("modes")
    return {
        **entry,
        "readings": pool.readings,
        "since_ns": pool.since_ns,
        "until_ns": pool.until_ns,
        "reference_readings": learnt_from,
        "false_alarm": level,
        "false_alarms_per_year": assessing.false_alarms_per_year,
    }


def _level(pool: ReadingPool, assessing: Assessing) -> float:
    """Probability of a false alarm that this comparison may spend [1]."""
    begun = pool.compared_ns if pool.compared_ns is not None else pool.since_ns
    years = max(pool.until_ns - begun, 0) / YEAR_NS
    spent = assessing.false_alarms_per_year * years
    return min(max(spent, LEAST_PROBABLE), MOST_PROBABLE)


def _reference(
    compared: Sequence[ComparedMode], nominal: Nominal, now: MeasuredModes
) -> MeasuredModes:
    """Modes of the model at learning, at the channels of those of the present."""
    which = [one.place for one in compared]
    frequency, shapes = nominal.frequency_hz[which], nominal.shapes[which]
    if now.shapes is None:
        return MeasuredModes(frequency_hz=frequency, frequency_sd_hz=_EXACT * frequency)
    size_of = np.linalg.norm(shapes, axis=1, keepdims=True)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=_EXACT * frequency,
        shapes=shapes,
        shape_sd=_EXACT * np.maximum(size_of, _EXACT) * np.ones(shapes.shape),
        channels=now.channels,
    )


def groups_of(assessed: dict[str, Any] | None) -> tuple[SuspectGroup, ...]:
    """Name the members of a verdict, one group for each that has changed."""
    if assessed is None or assessed["verdict"] != "changed":
        return ()
    return tuple(
        SuspectGroup(
            " or ".join(one["name"] for one in some),
            tuple(size(one["name"], -one["loss"], one["sd"]) for one in some),
        )
        for some in assessed["sets"]
    )
