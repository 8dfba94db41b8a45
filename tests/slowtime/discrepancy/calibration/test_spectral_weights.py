"""What noise is expected to be once holes are cut into it, against noise with holes."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.discrepancy.calibration import spectral_weights
from slowtime.discrepancy.calibration.spectral_weights import _masked_density
from slowtime.discrepancy.noise import Colour, Noise
from slowtime.discrepancy.records import Trial

SAMPLES, POLE, RATE = 1200, 0.95, 100.0


def density():
    """Shape of the noise, by line: steep, as an accelerometer's that drifts."""
    turn = np.pi * np.arange(SAMPLES // 2 + 1) / (SAMPLES // 2)
    return 1 / np.abs(1 - POLE * np.exp(-1j * turn)) ** 2


def cut(records, use, seed):
    """Mean squared spectrum of such noise with holes, over its number of samples."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((records, SAMPLES + 400))
    noise = sps.lfilter([1.0], [1.0, -POLE], white, axis=1)[:, 400:] * use
    return np.mean(np.abs(np.fft.rfft(noise, axis=1)) ** 2, axis=0) / use.sum()


def test_noise_with_holes_is_as_loud_at_every_line_as_is_expected():
    gone = np.random.default_rng(5).random(SAMPLES) < 0.02
    use = 1.0 - np.convolve(gone, np.ones(4), "same").clip(0.0, 1.0).round()
    found, expected = cut(3000, use, 1), _masked_density(density(), use)
    # But for the lowest, where a record of this length wraps around.
    np.testing.assert_allclose(found[8:], expected[8:], rtol=0.12)
    assert expected[-200:].mean() > 1.5 * density()[-200:].mean()


def test_white_noise_does_not_leak_and_without_holes_nothing_does():
    use = np.random.default_rng(2).random(SAMPLES) < 0.8
    np.testing.assert_allclose(
        _masked_density(np.full(SAMPLES // 2 + 1, 3.0), use.astype(float)), 3.0, rtol=1e-12
    )
    for whole in (np.ones(SAMPLES), np.zeros(SAMPLES)):
        np.testing.assert_array_equal(_masked_density(density(), whole), density())


def test_residuals_with_holes_are_weighed_by_what_is_expected_of_them():
    """As loud as it is said to be, in its low lines and in its high ones."""
    gone = np.random.default_rng(6).random(SAMPLES) < 0.02
    use = np.convolve(gone, np.ones(4), "same") < 0.5
    # A pole near one is a low pass of the first order, as long as its corner is low.
    colour = Colour(white=1e-6, coloured=1.0, corner_hz=0.5, slope=2.0)
    noise = Noise(colours=((colour,),), relative_sd=((0.0,),))
    frequency = np.fft.rfftfreq(SAMPLES, 1 / RATE).astype(np.float64)
    root = np.sqrt(noise.weighting_density(0, frequency)[:, 0] * RATE * SAMPLES / 4)
    rng, by_line = np.random.default_rng(7), []
    for _ in range(200):
        lines = root * (rng.standard_normal((2, len(root))) * [[1], [1j]]).sum(axis=0)
        left = np.fft.irfft(lines, SAMPLES)[:, None]
        trial = Trial(
            inputs=np.zeros((SAMPLES, 0)), outputs=left, rate_hz=RATE, use=use[:, None]
        )
        by_line.append(
            spectral_weights(trial, noise, 0).chi2_by_line(np.where(trial.used, left, 0.0))
        )
    power = np.mean(by_line, axis=0)[1:-1, 0] / 2
    for band in np.array_split(power, 10):
        assert band.mean() == pytest.approx(1.0, abs=0.1)
