"""Constant offsets of inputs and sensors that are fitted from the beginning, as effects.

A constant error of a force displaces a supported structure a little, but makes an unsupported
one drift away, so that no free run fits. A free decay is symmetric about its position of rest,
where a displacement sensor or a gyroscope seldom reads zero: without an offset of the sensor,
a one-sided stop or stiffness seems to be missing. Therefore each input of an unsupported
structure, and each sensor of displacement or velocity in a free decay, has an offset. It is
fitted from the beginning, as initial states are, and reported where it is significant.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.library_fit import OFFSET
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.quoting import numbers_of, sentence_of
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

SENSOR_OFFSET = "sensor_bias"
"""Kind of effect that is the offset of a sensor."""
REPORTED_SDS = 3.3
"""[standard deviations] From zero, from which an offset is reported. Source: a two-sided
p-value of 1 in 1000."""


def with_offsets(
    description: Description, kinds: Mapping[str, Kind], *, decays: bool
) -> Description:
    """Add the offsets that records of such a structure need, with a value of zero.

    Parameters
    ----------
    description
        Model of the structure.
    kinds
        Catalogue of effects by name.
    decays
        Whether the records are free decays.
    """
    return dataclasses.replace(
        description,
        effects=(
            *description.effects,
            *_of_inputs(description, kinds),
            *(_of_sensors(description, kinds) if decays else ()),
        ),
    )


def _of_inputs(
    description: Description, kinds: Mapping[str, Kind]
) -> tuple[Mapping[str, Any], ...]:
    if OFFSET not in kinds or not has_rigid_motion(description):
        return ()
    has = {str(e.get("input")) for e in description.effects if e["effect"] == OFFSET}
    return tuple(
        {"effect": OFFSET, "input": entry.channel, "bias": 0.0}
        for entry in description.inputs
        if entry.channel not in has
    )


def _of_sensors(
    description: Description, kinds: Mapping[str, Kind]
) -> tuple[Mapping[str, Any], ...]:
    if SENSOR_OFFSET not in kinds:
        return ()
    has = {str(e.get("sensor")) for e in description.effects if e["effect"] == SENSOR_OFFSET}
    return tuple(
        {"effect": SENSOR_OFFSET, "sensor": sensor.channel, "bias": 0.0}
        for sensor in description.sensors
        if sensor.quantity in ("displacement", "velocity") and sensor.channel not in has
    )


def offsets(fit: Fit, given: Description, kinds: Mapping[str, Kind]) -> list[NamedEffect]:
    """List the offsets added to the given model that differ significantly from zero."""
    found = []
    for number, effect in enumerate(fitted_effects(fit)):
        if effect.kind not in (OFFSET, SENSOR_OFFSET) or number < len(given.effects):
            continue
        numbers = numbers_of(fit, number)
        if abs(numbers["bias"].value) <= REPORTED_SDS * numbers["bias"].sd:
            continue
        kind = kinds[effect.kind]
        found.append(
            NamedEffect(
                effect=effect,
                family=kind.family,
                numbers=numbers,
                probability=0.99,
                rivals=(),
                sentence=sentence_of(kind, effect.place, numbers),
            )
        )
    return found
