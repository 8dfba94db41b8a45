"""Largest responses of single-degree-of-freedom oscillators to a motion of their base."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

LEAST_STEPS = 20
"""[steps per natural period] Steps of a response: between two of them a peak is missed by at
most 1 - cos(pi / 20) = 1.2 %, half of that on average."""

LEAST_FACTOR = 4
"""[1] Samples made of one at least: a motion at a quarter of the sampling rate has then 16
steps per period, and straight lines between them cut off 1.3 % of its peak ((pi / 16)² / 3)."""


class ResponseSpectra(NamedTuple):
    """Largest absolute values over time; axes: oscillator, channel.

    Parameters
    ----------
    displacement
        Of the oscillator relative to the base [m].
    pseudo_velocity
        Displacement times 2 pi f [m/s].
    pseudo_acceleration
        Displacement times (2 pi f)² [m/s²].
    acceleration
        Of the oscillator's mass, in space [m/s²].
    """

    displacement: Float[np.ndarray, "oscillator channel"]
    pseudo_velocity: Float[np.ndarray, "oscillator channel"]
    pseudo_acceleration: Float[np.ndarray, "oscillator channel"]
    acceleration: Float[np.ndarray, "oscillator channel"]


def response_spectra(
    acceleration: Float[np.ndarray, "time channel"],
    rate_hz: float,
    frequencies_hz: Float[np.ndarray, " oscillator"],
    damping_ratio: float = 0.05,
) -> ResponseSpectra:
    """Compute response spectra of accelerations of a base.

    Each oscillator starts at rest and goes on for one of its periods after the record. Its
    motion is exact for an acceleration that is straight between samples [1]_; samples are first
    made denser without changing their spectrum.

    Parameters
    ----------
    acceleration
        Of the base [m/s²].
    frequencies_hz
        Undamped natural frequencies of the oscillators [Hz].
    damping_ratio
        Of all of them [1], below 1.

    References
    ----------
    .. [1] N. C. Nigam and P. C. Jennings, "Calculation of response spectra from strong-motion
       earthquake records", Bulletin of the Seismological Society of America 59 (1969).
    """
    frequencies = np.asarray(frequencies_hz, dtype=float)
    factors = np.maximum(
        LEAST_FACTOR,
        2 ** np.ceil(np.log2(LEAST_STEPS * frequencies / rate_hz)),
    ).astype(int)
    largest = np.empty((2, frequencies.size, acceleration.shape[1]))
    for factor in np.unique(factors):
        dense = _denser(acceleration, int(factor))
        for k in np.flatnonzero(factors == factor):
            largest[:, k] = _largest(dense, rate_hz * factor, frequencies[k], damping_ratio)
    omega = 2 * np.pi * frequencies[:, None]
    return ResponseSpectra(largest[0], omega * largest[0], omega**2 * largest[0], largest[1])


def _denser(
    acceleration: Float[np.ndarray, "time channel"], factor: int
) -> Float[np.ndarray, "dense channel"]:
    # The filter of the resampling rings before an onset; zeros make room for that.
    still = np.zeros((16, acceleration.shape[1]))
    padded = np.concatenate((still, acceleration, still))
    return np.asarray(scipy.signal.resample_poly(padded, factor, 1, axis=0))


def _largest(
    acceleration: Float[np.ndarray, "time channel"], rate_hz: float, f: float, zeta: float
) -> Float[np.ndarray, "quantity channel"]:
    omega = 2 * np.pi * f
    after = np.zeros((int(np.ceil(rate_hz / f)), acceleration.shape[1]))
    whole = np.concatenate((acceleration, after))
    recursion, (to_displacement, to_velocity) = _recursion(omega, zeta, 1 / rate_hz)
    displacement = scipy.signal.lfilter(to_displacement, recursion, whole, axis=0)
    velocity = scipy.signal.lfilter(to_velocity, recursion, whole, axis=0)
    in_space = -(2 * zeta * omega * velocity + omega**2 * displacement)
    return np.asarray(np.abs(np.stack((displacement, in_space))).max(axis=1))


def _recursion(
    omega: float, zeta: float, step: float
) -> tuple[Float[np.ndarray, "3"], tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]:
    """Recursive filter from the base's acceleration to displacement and velocity."""
    # Exact solution over a step: state, acceleration at its beginning, and its change over it.
    motion = np.zeros((4, 4))
    motion[0, 1] = step
    motion[1, :3] = -(omega**2) * step, -2 * zeta * omega * step, -step
    motion[2, 3] = 1.0
    over = scipy.linalg.expm(motion)
    (a11, a12), (a21, a22) = over[:2, :2]
    (p0, p1), (v0, v1) = (
        (over[row, 2] - over[row, 3], over[row, 3]) for row in (0, 1)
    )  # weights of the accelerations at beginning and end
    recursion = np.array([1.0, -(a11 + a22), a11 * a22 - a12 * a21])
    to_displacement = np.array([p1, p0 - a22 * p1 + a12 * v1, a12 * v0 - a22 * p0])
    to_velocity = np.array([v1, v0 - a11 * v1 + a21 * p1, a21 * p0 - a11 * v0])
    return recursion, (to_displacement, to_velocity)
