"""Converts the modes of one epoch to frequencies and displacement shapes over the channels."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from slowtime.identification.mode_shapes.criteria import real_shape
from slowtime_schemas.messages import Features, Mode
from twin_server.registration.structure import ElementModel

from .channel_units import ChannelUnits, as_displacement, units_of

MOST_UNCERTAIN = 0.1
"""Relative sd of a frequency from which a mode says too little to be used."""

LEAST_SD = 1e-9
"""Of a frequency, relative, or of a component of a shape: nobody knows them better."""

_FEWEST = 2
"""Channels that a shape must have, at least."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ObservedMode:
    """One structural mode of one epoch.

    Parameters
    ----------
    place
        Its place among the modes of the message.
    frequency_hz, relative_sd
        As measured.
    damping_ratio, damping_sd
        NaN where not known.
    identity
        What the edge calls it.
    shape, shape_sd
        Real, of unit norm, per channel of the model, NaN where not heard; None without.
    """

    place: int
    frequency_hz: float
    relative_sd: float
    damping_ratio: float
    damping_sd: float
    identity: int | None
    shape: Float[np.ndarray, " channel"] | None
    shape_sd: Float[np.ndarray, " channel"] | None


def observed_modes(features: Features, model: ElementModel) -> list[ObservedMode]:
    """Return the modes of a message that belong to the structure and are precise enough."""
    found, units = [], units_of(features, model)
    for place, mode in enumerate(features.modes):
        frequency, sd = mode.frequency_hz.value, mode.frequency_hz.sd
        if mode.kind != "structural" or not 1e-9 < frequency < 1e9:
            continue
        if not sd < MOST_UNCERTAIN * frequency:
            continue
        damping = mode.damping_ratio
        known = 0.0 < damping.value < 1.0 and damping.sd < 1.0
        shape, shape_sd = _shape(mode, features.channels, model, units)
        found.append(
            ObservedMode(
                place,
                frequency,
                max(sd / frequency, LEAST_SD),
                damping.value if known else math.nan,
                damping.sd if known else math.nan,
                mode.identity,
                shape,
                shape_sd,
            )
        )
    return found


def _shape(
    mode: Mode, channels: tuple[str, ...], model: ElementModel, units: ChannelUnits
) -> tuple[Float[np.ndarray, " channel"] | None, Float[np.ndarray, " channel"] | None]:
    """Real shape over the model's channels, and the sds of its components."""
    heard = [name for name in channels if name in model.sees and name in units.worth]
    if mode.shape is None or len(set(heard)) < max(_FEWEST, len(heard)):
        return None, None
    at = [channels.index(name) for name in heard]
    measured = np.array(mode.shape.re)[at] + 1j * np.array(mode.shape.im)[at]
    frequency, worth = mode.frequency_hz.value, [units.worth[name] for name in heard]
    moved = as_displacement(measured, worth, frequency)
    norm = float(np.linalg.norm(moved))
    if not 0.0 < norm < math.inf:
        return None, None
    # Half of a complex deviation lies along the real line.
    sd = np.abs(as_displacement(np.array(mode.shape.sd)[at] + 0j, worth, frequency)) / (
        norm * math.sqrt(2.0)
    )
    to = [model.channels.index(name) for name in heard]
    shape, shape_sd = np.full((2, len(model.channels)), np.nan)
    shape[to] = real_shape(moved / norm)
    shape_sd[to] = np.where((sd > 0.0) & (sd < 1.0), np.maximum(sd, LEAST_SD), np.nan)
    if np.isfinite(shape_sd).sum() < _FEWEST:
        return None, None
    return shape, shape_sd
