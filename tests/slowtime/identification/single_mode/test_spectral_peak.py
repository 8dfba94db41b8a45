"""A peak at the edge of what a short record resolves is read, not refused."""

import numpy as np
import pytest
from scipy.signal import lfilter

from slowtime.identification.single_mode.spectral_peak import peak


@pytest.mark.parametrize(("hertz", "noise"), [(0.92, 1e-3), (3.09, 1e-3), (30.06, 1.0)])
def test_a_tone_near_either_end_of_a_short_spectrum_has_a_peak(hertz, noise):
    wave = np.sin(2 * np.pi * hertz * np.arange(32) / 64.0)
    found = peak(wave + noise * np.random.default_rng(32).standard_normal(32), 64.0)
    assert 0 < found.frequency_hz.value <= 32.0


@pytest.mark.parametrize(("seconds", "damping"), [(40.0, 0.01), (60.0, 0.01), (60.0, 0.03)])
def test_intervals_of_short_windows_hold(seconds, damping):
    rng = np.random.default_rng(9)
    omega, count = 2 * np.pi * 3.0, int(50.0 * seconds)
    decay, turn = np.exp(-damping * omega / 50), omega * np.sqrt(1 - damping**2) / 50
    poles = [1.0, -2 * decay * np.cos(turn), decay**2]
    motion = lfilter([decay * np.sin(turn)], poles, rng.standard_normal(130 * count))
    windows = motion[10 * count :].reshape(120, count, 1)
    found = [peak(window, 50.0) for window in windows]
    for truth, told, least in (
        (3.0, [one.frequency_hz for one in found], 0.95),
        (damping, [one.damping_ratio for one in found], 0.87),
    ):
        held = np.mean([abs(one.value - truth) <= 1.96 * one.sd for one in told])
        assert held > least - 2.6 * np.sqrt(least * (1 - least) / 120)
