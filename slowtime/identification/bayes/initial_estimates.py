"""Initial frequency, damping and shape of each candidate mode."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.ambient.whittle import Periodogram, fit_resonance

NARROWEST_BINS = 1.0
"""Least half-bandwidth in the layout of bands [bins]."""

FIRST_DAMPINGS = (0.002, 0.01, 0.04)
"""Initial damping ratios; the likeliest fit is kept [1]."""

LOOKED_AT = 0.15
"""Half-width of the first fit, relative to the candidate's frequency [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RecordSpectrum:
    """Fourier coefficients of a whole record, channels scaled alike."""

    frequency_hz: Float[np.ndarray, " frequency"]
    coefficients: Complex[np.ndarray, "frequency channel"]
    rate_hz: float
    count: int
    derivatives: int

    @property
    def duration_s(self) -> float:
        """Of the record [s]."""
        return self.count / self.rate_hz


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class InitialEstimate:
    """What a candidate looks like before it is fitted with its neighbours."""

    frequency_hz: float
    damping_ratio: float
    shape: Float[np.ndarray, " channel"]

    def half_width_hz(self, duration_s: float) -> float:
        """Half-bandwidth, or the resolution of the record if that is larger [Hz]."""
        return max(self.damping_ratio * self.frequency_hz, NARROWEST_BINS / duration_s)


def initial_estimate(
    record: RecordSpectrum, frequency_hz: float, low_hz: float, high_hz: float
) -> InitialEstimate:
    """Frequency and damping of one resonance in the best weighted sum of channels."""
    f = record.frequency_hz
    low = max(low_hz, frequency_hz * (1 - LOOKED_AT), f[1])
    high = min(high_hz, frequency_hz * (1 + LOOKED_AT))
    use = np.flatnonzero((f >= low) & (f <= high))
    least = np.argmin(np.abs(f - frequency_hz)) + np.arange(-6, 7)
    use = np.union1d(use, least[(least > 0) & (least < len(f) - 1)])
    near = np.abs(f[use] - frequency_hz) <= max(2.5 / record.duration_s, 2e-3 * frequency_hz)
    peak = record.coefficients[use[near]]
    values, vectors = np.linalg.eigh((peak.T @ peak.conj()).real / len(peak))
    direction = vectors[:, -1]
    density = np.abs(record.coefficients[use] @ direction) ** 2
    data = Periodogram(
        frequency_hz=f[use],
        density=density,
        number=np.ones(len(use)),
        rate_hz=record.rate_hz,
        count=record.count,
        derivatives=record.derivatives,
    )
    place = float(np.clip(frequency_hz, f[use[1]], f[use[-2]]))
    floor = float(np.median(density)) / np.log(2.0)
    top = max(float(values[-1]), 2.0 * floor)
    fits = [fit_resonance(data, np.log([place, z, top, 0.3 * floor])) for z in FIRST_DAMPINGS]
    found, damping, peak_density, _ = max(fits, key=lambda fit: fit.log_likelihood).parameters
    strength = np.sqrt(np.exp(peak_density))
    return InitialEstimate(float(np.exp(found)), float(np.exp(damping)), direction * strength)


def initial_estimates(
    record: RecordSpectrum, candidates_hz: Float[np.ndarray, " mode"]
) -> tuple[InitialEstimate, ...]:
    """Estimate all candidates, each up to half way to its neighbours."""
    middles = 0.5 * (candidates_hz[1:] + candidates_hz[:-1])
    lows = np.concatenate([[0.0], middles])
    highs = np.concatenate([middles, [np.inf]])
    found = [
        initial_estimate(record, float(f), float(low), float(high))
        for f, low, high in zip(candidates_hz, lows, highs, strict=True)
    ]
    return tuple(sorted(found, key=lambda guess: guess.frequency_hz))
