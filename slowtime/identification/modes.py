"""The estimate of one mode of vibration: frequency, damping, shape and flags."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from .estimates import Measured

Kind = Literal["structural", "harmonic"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode:
    r"""One mode, read off the channels of one record.

    Parameters
    ----------
    frequency_hz
        Undamped natural frequency :math:`|s| / 2 \pi` of the pole s [Hz].
    damping_ratio
        :math:`-\mathrm{Re}\, s / |s|` [1].
    correlation
        Between the errors of frequency and of damping ratio.
    shape
        Of unit norm, largest component real and positive; 0 in channels that do not move.
        In the units of the channels: what each of them shows while the mode rings.
    shape_sd
        Standard deviation of the complex deviation of each component,
        :math:`\sqrt{\mathrm{E} |\hat\phi_j - \phi_j|^2}`.
    kind
        `structural`, or `harmonic`: the line of a machine, whose damping means nothing.
    quality
        Between 0 and 1: share of the model orders that could have shown the mode and did.
    flags
        Words on what to mistrust.
    """

    frequency_hz: Measured
    damping_ratio: Measured
    correlation: float
    shape: Complex[np.ndarray, " channel"]
    shape_sd: Float[np.ndarray, " channel"]
    kind: Kind = "structural"
    quality: float = 1.0
    flags: tuple[str, ...] = ()
