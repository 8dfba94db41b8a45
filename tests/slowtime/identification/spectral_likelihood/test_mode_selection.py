"""Modes of a spectrum as the theory of light damping says they are known."""

import numpy as np
import pytest

from slowtime.identification.spectral_likelihood.mode_selection import (
    InitialMode,
    fit_modes,
    widen_for_windows,
)
from slowtime.identification.spectral_likelihood.windows import Spectrum


def drawn_spectrum(pole, shape, spacing_hz, seed):
    """Coefficients of a mode under white force with noise 40 dB below its peak."""
    rng = np.random.default_rng(seed)
    s = 2j * np.pi * spacing_hz * np.arange(round(3 * pole.imag / (2 * np.pi) / spacing_hz))
    gain = -pole.real / (s - pole)
    force, noise = (
        rng.standard_normal((len(s), n)) + 1j * rng.standard_normal((len(s), n))
        for n in (1, len(shape))
    )
    moved = gain[:, None] * force * shape
    return Spectrum(moved + 0.01 * noise, spacing_hz, np.zeros(len(s), dtype=bool))


@pytest.mark.parametrize(
    ("frequency_hz", "damping", "cycles"), [(3.0, 0.01, 3000), (0.2, 0.02, 1500)]
)
def test_decay_and_frequency_of_a_light_mode_are_known_as_whittle_says(
    frequency_hz, damping, cycles
):
    """The information of a record of length T about both is T over the decay rate."""
    decay, seconds = damping * 2 * np.pi * frequency_hz, cycles / frequency_hz
    pole = complex(-decay, 2 * np.pi * frequency_hz)
    shape = np.array([1.0, -0.5])
    ((_, mode),) = fit_modes(
        drawn_spectrum(pole, shape, 1 / seconds, 3),
        [InitialMode(1.02 * pole, shape.astype(complex))],
        low_hz=0.2 * frequency_hz,
        high_hz=2 * frequency_hz,
    )
    sd = np.sqrt(np.diag(mode.covariance))
    expected = np.array([1.0 / np.sqrt(decay * seconds), np.sqrt(decay / seconds)])
    np.testing.assert_allclose(sd, expected, rtol=0.25)
    assert abs(np.log(mode.pole.real / pole.real)) < 4 * sd[0]
    assert abs(mode.pole.imag - pole.imag) < 4 * sd[1]


def test_windows_that_agree_leave_errors_and_windows_that_do_not_widen_them():
    spacing, count = 0.002, 4000
    frequency = spacing * np.arange(count)
    rng = np.random.default_rng(21)
    poles, strength = 2 * np.pi * np.array([-0.02 + 2.0j, -0.03 + 2.4j]), 10.0
    s = 2j * np.pi * frequency[:, None]
    moved = (rng.standard_normal((count, 4)).view(complex)) / (s - poles) * [1.0, strength]
    noise = rng.standard_normal((count, 4)).view(complex)
    shapes = np.array([[1.0, 0.5], [1.0, 0.8]])
    spectrum = Spectrum(moved @ shapes + 0.1 * noise, spacing, np.zeros(count, dtype=bool))
    both = [InitialMode(pole, shape + 0j) for pole, shape in zip(poles, shapes, strict=True)]
    low_hz, high_hz = 0.1, 6.0

    def growth(starts):
        fitted = [one for _, one in fit_modes(spectrum, starts, low_hz=low_hz, high_hz=high_hz)]
        widened = widen_for_windows(spectrum, fitted, low_hz=low_hz, high_hz=high_hz)
        return np.diag(widened[0].covariance) / np.diag(fitted[0].covariance)

    assert growth(both).max() < 1.5
    # A neighbour that is left out pulls a wide window more than a narrow one.
    assert growth(both[:1]).max() > 3.0
