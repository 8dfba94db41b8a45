"""A peak at the edge of what a short record resolves is read, not refused."""

import numpy as np
import pytest

from slowtime.identification.single_mode.spectral_peak import peak


@pytest.mark.parametrize(("hertz", "noise"), [(0.92, 1e-3), (3.09, 1e-3), (30.06, 1.0)])
def test_a_tone_near_either_end_of_a_short_spectrum_has_a_peak(hertz, noise):
    wave = np.sin(2 * np.pi * hertz * np.arange(32) / 64.0)
    found = peak(wave + noise * np.random.default_rng(32).standard_normal(32), 64.0)
    assert 0 < found.frequency_hz.value <= 32.0
