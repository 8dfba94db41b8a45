"""The roll-off of a filter is no mode, and no skirt of one."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.automatic.roll_off import roll_off_hz

RATE = 12.0


def heard(seed):
    rng, count = np.random.default_rng(seed), 18_000
    samples = 0.2 * rng.standard_normal((count, 2))
    for hz, shape in ((2.8, [0.6, 1.0]), (4.05, [1.0, -0.7])):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, 0.01), count, RATE, rng)
        samples = samples + np.outer(ringing / ringing.std(), shape)
    return samples


def roll_off(samples):
    return roll_off_hz(np.fft.rfft(samples - samples.mean(axis=0), axis=0), 1.0)


@pytest.mark.parametrize("order", [4, 8])
def test_a_filter_is_seen_where_it_begins(order):
    noise = np.random.default_rng(1).standard_normal((20_000, 2))
    taps = sps.butter(order, 0.8)
    assert 0.65 < roll_off(sps.lfilter(*taps, noise, axis=0)) < 0.8


def test_noise_and_modes_have_none():
    for seed in range(5):
        assert roll_off(np.random.default_rng(seed).standard_normal((2000, 1))) == 1.0
        assert roll_off(heard(seed)) == 1.0


@pytest.mark.parametrize("seed", [2, 3])
def test_resampling_moves_no_mode(seed):
    samples = heard(seed)
    plain = identify_modes(samples, RATE).structural
    faster = identify_modes(sps.resample_poly(samples, 5, 4, axis=0), 1.25 * RATE).structural
    assert len(plain) == len(faster) == 2
    for one, other in zip(plain, faster, strict=True):
        for name in ("frequency_hz", "damping_ratio"):
            before, after = getattr(one, name), getattr(other, name)
            assert abs(after.value - before.value) < 0.6 * before.sd


def test_the_end_of_a_band_is_no_mode():
    noise = np.random.default_rng(4).standard_normal((30_000, 3))
    soft = sps.lfilter(*sps.cheby1(6, 1.0, 0.7), noise, axis=0)
    assert identify_modes(soft, RATE).structural == ()
