"""Standard errors of a fitted decay, and the power that it explains."""

import dataclasses

import numpy as np

from slowtime.identification.estimates import Identified, Measured
from slowtime.signals.spectra import periodogram

from .decay_fit import DecayFit

THRESHOLD = 12.0
"""Gain of log-likelihood over noise below which `below_threshold` is flagged."""

NEAR_BINS = 12
"""Half-width for the noise density next to a mode [bins]; at least three half-bandwidths."""

CLOSEST_BINS = 4
"""Half-width for the misfit of the mode itself [bins]."""


@dataclasses.dataclass(frozen=True, slots=True)
class SegmentFit:
    """A mode read off one stretch, its pole [1/s, rad/s], and how well decays explain it."""

    identified: Identified
    pole: complex
    others: int
    explained: float


@dataclasses.dataclass(frozen=True, slots=True)
class _Noise:
    """Variance per sample as dense as it is at the mode; what is left next to it."""

    variance: float
    coloured: bool
    unexplained: float
    near_power: float


def mode_of_fit(
    fit: DecayFit,
    which: int,
    rate_hz: float,
    start_s: float = 0.0,
    band_hz: tuple[float, float] | None = None,
    shift_hz: float = 0.0,
) -> SegmentFit:
    """One mode of a fit, with errors from the information and the noise next to it.

    The noise is judged over `band_hz`, or the whole spectrum; `shift_hz` was taken off all
    frequencies before. The pole is in rad/s; the share is that of the power that decays
    explain.
    """
    pole, modes, count = complex(fit.poles[which]), len(fit.poles), len(fit.residual)
    noise = _noise(fit, pole, rate_hz, band_hz)
    pole += 2j * np.pi * shift_hz
    pick = np.array([which, modes + which])
    covariance = noise.variance * fit.unit_covariance[np.ix_(pick, pick)]
    natural, damping = abs(pole), -pole.real / abs(pole)
    # Slopes of (|s|, -Re s / |s|) in (Re s, Im s).
    slopes = np.array(
        [
            [pole.real / natural, pole.imag / natural],
            [-(pole.imag**2) / natural**3, pole.real * pole.imag / natural**3],
        ]
    )
    both = slopes @ covariance @ slopes.T
    sd = np.sqrt(np.diag(both))
    amplitude = abs(fit.amplitudes[which])
    wave = amplitude**2 / 2 * _mean_square(-2 * pole.real, count / rate_hz)
    flags = ["coloured_residual"] if noise.coloured else []
    if 0.5 * count * np.log1p(wave / (fit.cost / count + 1e-300)) < THRESHOLD:
        flags.append("below_threshold")
    if damping <= 0:
        flags.append("not_decaying")
    if not fit.converged:
        flags.append("not_converged")
    identified = Identified(
        frequency_hz=Measured(natural / (2 * np.pi), float(sd[0]) / (2 * np.pi)),
        damping_ratio=Measured(damping, float(sd[1])),
        correlation=float(both[0, 1] / (sd[0] * sd[1])) if sd.all() else 0.0,
        snr_db=float(10 * np.log10(amplitude**2 / (2 * noise.variance))) if fit.cost else None,
        amplitude=float(amplitude),
        method="free_decay",
        span_s=(start_s, start_s + count / rate_hz),
        flags=tuple(flags),
    )
    # Of what this mode and the noise make up, and of what all modes together leave unexplained.
    own = wave / (wave + noise.near_power)
    explained = float(min(own, 1.0 - noise.unexplained))
    return SegmentFit(identified, pole, modes - 1, explained)


def _mean_square(rate: float, duration: float) -> float:
    """Mean of exp(-rate t) over the duration."""
    x = float(np.clip(rate * duration, -50.0, 1e9))
    return 1.0 if abs(x) < 1e-9 else float(-np.expm1(-x) / x)


def _noise(
    fit: DecayFit, pole: complex, rate_hz: float, band_hz: tuple[float, float] | None
) -> _Noise:
    """Read the residual: white over the band, or denser next to the mode than by chance."""
    count, modes = len(fit.residual), len(fit.poles)
    spectrum = periodogram(fit.residual[:, None], rate_hz)
    density, hz = spectrum.density[:, 0] * rate_hz / 2, spectrum.frequency_hz
    low, high = band_hz or (0.0, rate_hz / 2)
    inside = density[(hz > low) & (hz < high)]
    # Each mode has taken two pole and two amplitude parameters out of the ordinates, in pairs.
    white, freedom = _mean(inside, 2 * modes)
    widest = max(NEAR_BINS, int(3 * abs(pole.real) / (2 * np.pi) * count / rate_hz))
    centre = round(pole.imag / (2 * np.pi) * count / rate_hz)
    variance, coloured = white, False
    for width in (widest, CLOSEST_BINS):
        near = density[max(centre - width, 1) : centre + width + 1]
        local, free = _mean(near, 2 * modes)
        if local > max(variance, white * (1 + 2.6 / np.sqrt(free))):
            variance, freedom, coloured = local, free, True
    around = slice(max(centre - widest, 1), centre + widest + 1)
    waves = np.exp(np.multiply.outer(np.arange(count) / rate_hz, fit.poles))
    # All modes together: two close ones may each be larger than what they leave of each other.
    whole = fit.residual + (waves @ fit.amplitudes).real
    there = periodogram(whole[:, None], rate_hz).density[around, 0] * rate_hz / 2
    left, _ = _mean(density[around], 2 * modes)
    # The error of the error: what a t-distribution of so few freedoms adds to the variance.
    variance *= 1 + 1 / freedom
    return _Noise(
        variance,
        bool(coloured),
        left / (float(there.mean()) + 1e-300),
        float(density[around].sum()) / (count / 2),
    )


def _mean(ordinates: np.ndarray, spent: int) -> tuple[float, float]:
    free = max(float(len(ordinates) - spent), 1.0)
    return float(ordinates.sum()) / free, free
