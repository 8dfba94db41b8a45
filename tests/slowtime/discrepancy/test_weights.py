"""What noise is expected to be once holes are cut into it, against noise with holes."""

import numpy as np
import scipy.signal as sps

from slowtime.discrepancy.refit.weights import _leaked

SAMPLES, POLE = 1200, 0.95


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
    found, expected = cut(3000, use, 1), _leaked(density(), use)
    # But for the lowest, where a record of this length wraps around.
    np.testing.assert_allclose(found[8:], expected[8:], rtol=0.12)
    assert expected[-200:].mean() > 1.5 * density()[-200:].mean()


def test_white_noise_does_not_leak_and_without_holes_nothing_does():
    use = np.random.default_rng(2).random(SAMPLES) < 0.8
    np.testing.assert_allclose(
        _leaked(np.full(SAMPLES // 2 + 1, 3.0), use.astype(float)), 3.0, rtol=1e-12
    )
    for whole in (np.ones(SAMPLES), np.zeros(SAMPLES)):
        np.testing.assert_array_equal(_leaked(density(), whole), density())
