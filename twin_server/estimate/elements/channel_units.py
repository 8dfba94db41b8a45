r"""Factors that turn the channels of a message into displacements, by their units.

A mode that rings at :math:`\omega` moves a place by x, at a velocity of
:math:`i \omega x` and an acceleration of :math:`(i \omega)^2 x`, so that components of
sensors of several quantities become displacements each by its own power of
:math:`i \omega`. A component whose unit nobody knows becomes none, and is left out.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from slowtime.dynamics.units import UNITS as MODEL_UNITS
from slowtime_schemas.messages import Features, Mode
from slowtime_services.files.units import unit_of
from twin_server.registration.structure import POWERS, ElementModel, Worth

UNSTATED = frozenset(("", "1", "-"))
"""Units by which an edge says that nobody told it one."""

DIGITS = 12
"""Of a shape's components after the point, as they are told."""


@dataclasses.dataclass(frozen=True, slots=True)
class ChannelUnits:
    """Factors by which the channels of a message form one displacement shape.

    Parameters
    ----------
    worth
        Of each channel that may: worth of its unit in SI, and how often its quantity is
        differentiated.
    doubts
        Sentences on channels that are left out, or whose unit is only the model's.
    mixed
        Whether the components of a message differ in unit, and compare only as displacements.
    """

    worth: Mapping[str, Worth]
    doubts: tuple[str, ...] = ()
    mixed: bool = False


@functools.lru_cache(maxsize=256)
def channel_units(
    model: ElementModel, channels: tuple[str, ...], units: tuple[str, ...]
) -> ChannelUnits:
    """Return the units that the edge states; those of the model if it states none.

    What stands in one unit for all channels, even an unknown one, is taken for what the model
    says, since components then compare. Among known units an unstated one is taken from the
    model with a warning, and an unknown one, such as volts, is left out with a warning.
    """
    if not units:
        return ChannelUnits(model.worth)
    told = dict(zip(channels, units, strict=True))
    known = {name: _worth(unit, name, model) for name, unit in told.items()}
    motion = {name: worth for name, worth in known.items() if worth is not None}
    unknown = [name for name in told if name not in motion]
    mixed = len(set(motion.values()) | {told[name] for name in unknown}) > 1
    if not mixed and unknown:
        return ChannelUnits(model.worth, tuple(_of_one_unit(unknown, told, model)))
    unstated = [name for name in unknown if told[name] in UNSTATED and name in model.worth]
    lost = [name for name in unknown if name not in unstated]
    doubts = (
        *_contradicting(motion, told, model),
        *_unstated(unstated, model),
        *_lost(lost, told),
    )
    return ChannelUnits(motion | {name: model.worth[name] for name in unstated}, doubts, mixed)


def units_of(features: Features, model: ElementModel) -> ChannelUnits:
    """Return the factors by which the channels of a message form one shape."""
    return channel_units(model, features.channels, features.units)


def as_displacement(
    shape: Complex[np.ndarray, " channel"], worth: Sequence[Worth], frequency_hz: float
) -> Complex[np.ndarray, " channel"]:
    """Shape in metres out of one in the units and quantities of its channels.

    Parameters
    ----------
    shape
        Mode shape in the units of its channels.
    worth
        Factor to SI and number of time derivatives of each channel.
    frequency_hz
        Natural frequency [Hz].

    Returns
    -------
    Mode shape in displacements [m].
    """
    omega = 2.0 * np.pi * frequency_hz
    factors = [factor / (1j * omega) ** power for factor, power in worth]
    return np.asarray(shape * np.array(factors))


def told_shape(mode: Mode, features: Features, model: ElementModel) -> dict[str, Any] | None:
    """Return the mode shape that the twin reports: as received, or in displacements.

    None where its components stand in several units and one of them is unknown.
    """
    if mode.shape is None:
        return None
    units = units_of(features, model)
    if not units.mixed:
        return mode.shape.model_dump()
    if any(name not in units.worth for name in features.channels):
        return None
    worth, frequency = [units.worth[name] for name in features.channels], mode.frequency_hz
    measured = np.array(mode.shape.re) + 1j * np.array(mode.shape.im)
    moved = as_displacement(measured, worth, frequency.value)
    sd = np.abs(as_displacement(np.array(mode.shape.sd) + 0j, worth, frequency.value))
    norm = float(np.linalg.norm(moved))
    if not 0.0 < norm < math.inf or not np.isfinite(sd / norm).all():
        return None
    largest = moved[np.argmax(np.abs(moved))]
    moved = moved * (largest.conjugate() / abs(largest) / norm)
    return {"re": _rounded(moved.real), "im": _rounded(moved.imag), "sd": (sd / norm).tolist()}


def _rounded(values: Float[np.ndarray, " channel"]) -> list[float]:
    rounded: list[float] = (values.round(DIGITS) + 0.0).tolist()
    return rounded


def _worth(unit: str, channel: str, model: ElementModel) -> Worth | None:
    """Worth of a unit of motion, or of rotation where the model's coordinate is an angle."""
    for quantity, power in POWERS.items():
        worth = MODEL_UNITS[model.unit_of_coordinate, quantity].get(unit)
        if worth is not None and model.unit_of_coordinate == "rad":
            return worth, power
    known = unit_of(unit, channel) if model.unit_of_coordinate == "m" else None
    return None if known is None else (known.factor, POWERS[known.quantity])


def _of_one_unit(names: list[str], told: Mapping[str, str], model: ElementModel) -> list[str]:
    heard = [name for name in names if name in model.worth]
    unit = told[names[0]]
    if unit in UNSTATED or len(heard) < 2:
        return []
    return [
        f"{', '.join(heard)} are in {unit!r}, which is not a unit of motion: one common "
        "sensitivity is assumed for all of them. Give the edge agent --reading sensitivity."
    ]


def _contradicting(
    motion: Mapping[str, Worth], told: Mapping[str, str], model: ElementModel
) -> list[str]:
    other = [n for n in motion if n in model.worth and motion[n][1] != model.worth[n][1]]
    words = {power: quantity for quantity, power in POWERS.items()}
    return [
        f"{name} is in {told[name]}, and the model's sensor gives "
        f"{words[model.worth[name][1]]}: the edge's unit is used. Correct the model's sensors, "
        "or the edge's --unit."
        for name in other
    ]


def _unstated(names: list[str], model: ElementModel) -> list[str]:
    if not names:
        return []
    verb = "has" if len(names) == 1 else "have"
    return [
        f"{', '.join(names)} {verb} no unit while other channels have one: the unit of "
        "the model's sensor is used. Give the edge agent --unit."
    ]


def _lost(names: list[str], told: Mapping[str, str]) -> list[str]:
    if not names:
        return []
    said = ", ".join(f"{name} in {told[name]!r}" for name in names)
    return [
        f"{said}: not a unit of motion, while other channels have one, so left out of "
        "mode shapes. Give the edge agent --unit or --reading sensitivity."
    ]
