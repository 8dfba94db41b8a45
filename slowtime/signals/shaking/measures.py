"""Peaks, energy and duration of an event of shaking."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from slowtime.signals.units import GRAVITY

ORDER = 4
"""[1] Order of the Butterworth high-pass, once forward and once backward."""


class Motion(NamedTuple):
    """Acceleration [m/s²], velocity [m/s] and displacement [m] of a record."""

    acceleration: Float[np.ndarray, "time channel"]
    velocity: Float[np.ndarray, "time channel"]
    displacement: Float[np.ndarray, "time channel"]


class EventMeasures(NamedTuple):
    """Measures of an event, one value per channel.

    Parameters
    ----------
    peak_acceleration, peak_velocity, peak_displacement
        Largest absolute values [m/s²], [m/s], [m].
    peak_time_s
        Time of the peak velocity since the first sample [s].
    rms_velocity
        Root mean square of the velocity over the whole record [m/s].
    arias_intensity
        Pi / (2 g) times the integral of the squared acceleration [m/s].
    cumulative_absolute_velocity
        Integral of the absolute acceleration [m/s].
    duration_s
        Time between 5 and 95 % of the Arias intensity [s].
    frequency_hz
        Dominating frequency: of the half wave in which the velocity has its peak [Hz].
    """

    peak_acceleration: Float[np.ndarray, " channel"]
    peak_velocity: Float[np.ndarray, " channel"]
    peak_displacement: Float[np.ndarray, " channel"]
    peak_time_s: Float[np.ndarray, " channel"]
    rms_velocity: Float[np.ndarray, " channel"]
    arias_intensity: Float[np.ndarray, " channel"]
    cumulative_absolute_velocity: Float[np.ndarray, " channel"]
    duration_s: Float[np.ndarray, " channel"]
    frequency_hz: Float[np.ndarray, " channel"]


def motion_of(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, corner_hz: float, order: int
) -> Motion:
    """Integrate or differentiate a record of motion, without what is slower than a corner.

    Parameters
    ----------
    samples
        Displacement, velocity or acceleration in SI units.
    corner_hz
        Of the high-pass, which shifts no phase [Hz]: there a quarter of the power is left.
    order
        Derivatives that the samples are of displacement [1]: 0, 1 or 2.
    """
    count = len(samples)
    # Without room for the ringing of the filter the end of a record would run into its start.
    length = scipy.fft.next_fast_len(count + int(np.ceil(4 * rate_hz / corner_hz)), real=True)
    frequency = scipy.fft.rfftfreq(length, 1 / rate_hz)
    with np.errstate(divide="ignore"):
        passed = 1 / (1 + (corner_hz / frequency) ** (2 * ORDER))
    spectrum = scipy.fft.rfft(samples - samples.mean(axis=0), length, axis=0)
    spectrum *= passed[:, None]
    # At zero frequency nothing is passed; any number but zero may stand in the quotient.
    differentiation = 2j * np.pi * np.where(frequency > 0, frequency, 1.0)[:, None]
    acceleration, velocity, displacement = (
        scipy.fft.irfft(spectrum * differentiation ** (wanted - order), length, axis=0)[:count]
        for wanted in (2, 1, 0)
    )
    return Motion(acceleration, velocity, displacement)


def event_measures(motion: Motion, rate_hz: float) -> EventMeasures:
    """Measure an event.

    References
    ----------
    A. Arias, "A measure of earthquake intensity", in Seismic Design for Nuclear Power Plants
    (1970); DIN 4150-3 (2016), annex D, for the dominating frequency.
    """
    acceleration, velocity, displacement = motion
    step = 1 / rate_hz
    energy = scipy.integrate.cumulative_trapezoid(acceleration**2, dx=step, axis=0, initial=0)
    peak = np.abs(velocity).argmax(axis=0)
    return EventMeasures(
        peak_acceleration=np.abs(acceleration).max(axis=0),
        peak_velocity=np.abs(velocity).max(axis=0),
        peak_displacement=np.abs(displacement).max(axis=0),
        peak_time_s=peak * step,
        rms_velocity=np.sqrt((velocity**2).mean(axis=0)),
        arias_intensity=np.pi / (2 * GRAVITY) * energy[-1],
        cumulative_absolute_velocity=scipy.integrate.trapezoid(
            np.abs(acceleration), dx=step, axis=0
        ),
        duration_s=_time_of(energy, 0.95, step) - _time_of(energy, 0.05, step),
        frequency_hz=np.array(
            [_half_wave(velocity[:, c], int(row), rate_hz) for c, row in enumerate(peak)]
        ),
    )


def _time_of(
    energy: Float[np.ndarray, "time channel"], share: float, step: float
) -> Float[np.ndarray, " channel"]:
    rows = np.arange(len(energy))
    return np.array([step * np.interp(share * column[-1], column, rows) for column in energy.T])


def _half_wave(velocity: Float[np.ndarray, " time"], row: int, rate_hz: float) -> float:
    """Frequency of the half wave around a row [Hz]; NaN where the record cuts it."""
    other_sign = np.flatnonzero(np.sign(velocity) != np.sign(velocity[row]))
    before, after = other_sign[other_sign < row], other_sign[other_sign > row]
    if not before.size or not after.size:
        return np.nan
    crossings = []
    for low in (before[-1], after[0] - 1):
        here, there = velocity[low], velocity[low + 1]
        crossings.append(low + here / (here - there))
    return float(rate_hz / (2 * (crossings[1] - crossings[0])))
