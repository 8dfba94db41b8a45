"""Estimate of the noise after a force has been removed from the residuals."""

import dataclasses

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.noise.estimate import (
    UNMEASURED_DENSITY,
    UNMEASURED_WEIGHT,
    estimate_noise_of_spectra,
    with_instrument_floor,
)
from slowtime.discrepancy.records import Trial
from slowtime.signals.spectra import transform

from .latent_force import Explanation
from .spectral_lines import TrialLines


def noise_log_likelihood(trials: tuple[TrialLines, ...]) -> float:
    """Part of the log likelihood that depends on the noise densities alone."""
    return -float(sum(np.sum(t.weight[:, None] * np.log(t.noise)) for t in trials))


def update_noise(
    fit: Fit, records: tuple[Trial, ...], trials: tuple[TrialLines, ...], found: Explanation
) -> tuple[TrialLines, ...]:
    """Estimate the noise from what a force leaves, and from the residual above its band."""
    powers = []
    for record, residual, trial, force in zip(
        records, fit.residual, trials, found.forces, strict=True
    ):
        frequency, spectrum = transform(residual, record.rate_hz)
        power = np.abs(spectrum) ** 2
        power[: len(trial.frequency_hz)] = force.noise_power()
        share = np.maximum(record.used.mean(axis=0), 1 / len(residual))
        heard = record.used.any(axis=0)
        level = np.where(heard, power[1:] / share, UNMEASURED_DENSITY)
        powers.append((frequency[1:], level, np.where(heard, share, UNMEASURED_WEIGHT)))
    noise = estimate_noise_of_spectra(
        powers, rate_hz=records[0].rate_hz, silent_above_hz=fit.silent_above_hz
    )
    noise = dataclasses.replace(with_instrument_floor(noise, records), drift=fit.noise.drift)
    return tuple(
        dataclasses.replace(
            trial,
            noise=noise.weighting_density(i, trial.frequency_hz)
            * np.maximum(record.used.mean(axis=0), 1 / trial.samples),
        )
        for i, (trial, record) in enumerate(zip(trials, records, strict=True))
    )
