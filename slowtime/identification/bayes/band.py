"""Grouped Fourier coefficients of one frequency band."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

GROUPED = 12.0
"""Reciprocal width of the averages, in distances to the nearest mode."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Band:
    """What a band of a record of `duration_s` seconds holds, neighbouring bins taken together.

    Of `number` bins about each frequency `scatter` is the sum of :math:`F F^H`. `derivatives`
    is 2 for accelerations, 1 velocities, 0 displacements. The `background` is a known part of
    the spectral matrix: the tails of modes outside.
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    scatter: Complex[np.ndarray, "frequency channel channel"]
    number: Float[np.ndarray, " frequency"]
    duration_s: float
    derivatives: int = 2
    background: Complex[np.ndarray, "frequency channel channel"] | None = None

    @property
    def middle_hz(self) -> float:
        """Geometric mean of its ends [Hz]."""
        return float(np.sqrt(self.frequency_hz[0] * self.frequency_hz[-1]))


def band_from(
    frequency_hz: Float[np.ndarray, " bin"],
    coefficients: Complex[np.ndarray, "bin channel"],
    duration_s: float,
    derivatives: int,
    centres_hz: Float[np.ndarray, " mode"],
) -> Band:
    """Average neighbouring coefficients over a part of their distance to the nearest mode."""
    # A resonance falls off like the square of that distance, so that nothing is lost.
    away = np.abs(frequency_hz[:, None] - centres_hz).min(axis=1) * duration_s
    group = np.floor(np.cumsum(1.0 / np.maximum(1.0, away / GROUPED)) + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    number = np.diff(starts, append=len(away)).astype(float)
    each = coefficients[:, :, None] * coefficients[:, None, :].conj()
    return Band(
        frequency_hz=np.add.reduceat(frequency_hz, starts) / number,
        scatter=np.add.reduceat(each, starts),
        number=number,
        duration_s=duration_s,
        derivatives=derivatives,
    )


def coloured(band: Band, exponent: float) -> tuple[Band, float]:
    """Return a band as under white forces, where their density goes with a power of frequency.

    Beside it, what the scale adds to a log-density of the coefficients as they were.
    """
    log_scale = -2.0 * exponent * np.log(band.frequency_hz / band.middle_hz)
    scale = np.exp(log_scale)[:, None, None]
    background = None if band.background is None else band.background * scale
    jacobian = band.scatter.shape[1] * float(band.number @ log_scale)
    scaled = dataclasses.replace(band, scatter=band.scatter * scale, background=background)
    return scaled, jacobian
