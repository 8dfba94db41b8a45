"""What says nothing of the structure changes nothing: order, units, rate, a second less."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.methods import by_method
from slowtime.identification.options import AllChannels

RATE = 20.0
NATURAL_HZ, DAMPING = (1.5, 2.4, 4.2), 0.01
SHAPES = np.array([[1.0, 0.5, 0.9, 0.2], [0.6, 1.0, -0.7, -0.8], [0.3, -0.9, -0.5, 1.0]])
METHODS: tuple[AllChannels, ...] = ("modes", "efdd")


@pytest.fixture(scope="module")
def samples():
    rng, count = np.random.default_rng(1), 16_000
    heard = 0.1 * rng.standard_normal((count, 4))
    for hz, shape in zip(NATURAL_HZ, SHAPES, strict=True):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, DAMPING), count, RATE, rng)
        heard = heard + np.outer(ringing / ringing.std(), shape)
    return heard


@pytest.fixture(scope="module")
def plain(samples):
    return {method: by_method(samples, RATE, method=method).structural for method in METHODS}


def largest_shift(before, after):
    """Largest shift of frequency and damping [sd before]; every mode has to be there."""
    shifts = []
    for mode in before:
        hz, zeta = mode.frequency_hz, mode.damping_ratio
        same = min(after, key=lambda one: abs(one.frequency_hz.value - hz.value))
        shifts.append((same.frequency_hz.value - hz.value) / hz.sd)
        if np.isfinite(zeta.sd):
            shifts.append((same.damping_ratio.value - zeta.value) / zeta.sd)
    return float(np.abs(shifts).max())


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_channels_changes_nothing(samples, plain, method):
    other = by_method(samples[:, [2, 0, 3, 1]], RATE, method=method).structural
    assert len(other) == len(plain[method])
    assert largest_shift(plain[method], other) < 0.2


@pytest.mark.parametrize("method", METHODS)
def test_the_unit_of_a_channel_changes_nothing(samples, plain, method):
    units = [1e-6, 1.0, 9.80665, 1e6]
    other = by_method(samples * units, RATE, method=method).structural
    assert len(other) == len(plain[method])
    assert largest_shift(plain[method], other) < 0.05


@pytest.mark.parametrize("left_out", [0, 3])
def test_a_channel_less_costs_no_more_than_it_told(samples, plain, left_out):
    fewer = np.delete(samples, left_out, axis=1)
    other = by_method(fewer, RATE, method="modes").structural
    assert len(other) == len(plain["modes"])
    assert largest_shift(plain["modes"], other) < 1.0


@pytest.mark.parametrize("part", [slice(20, None), slice(None, -20), slice(7, -11)])
def test_a_second_less_changes_nothing(samples, plain, part):
    other = by_method(samples[part], RATE, method="modes").structural
    assert len(other) == len(plain["modes"])
    assert largest_shift(plain["modes"], other) < 1.0


@pytest.mark.parametrize(("up", "down"), [(5, 4), (3, 2), (4, 5)])
def test_another_rate_changes_nothing(samples, plain, up, down):
    resampled = sps.resample_poly(samples, up, down, axis=0)
    other = by_method(resampled, RATE * up / down, method="modes").structural
    assert len(other) == len(plain["modes"])
    assert largest_shift(plain["modes"], other) < 1.0


@pytest.mark.long
def test_a_measured_tower_keeps_its_modes(data):
    heard = np.loadtxt(data / "unison_tower" / "wn_01.dat")[:, 1:]
    known = [
        mode
        for mode in by_method(heard, 100.0, method="modes").structural
        if mode.frequency_hz.value < 7.0
    ]
    assert len(known) == 8
    for other, limit in (
        (heard[:, ::-1], 0.5),
        (heard * np.logspace(-6, 6, 7), 0.1),
        (heard[100:], 1.0),
        (heard[:-100], 1.0),
    ):
        assert largest_shift(known, by_method(other, 100.0, method="modes").structural) < limit


@pytest.mark.long
def test_five_channels_of_a_measured_tower_show_its_modes_in_a_band(data):
    heard = np.loadtxt(data / "unison_tower" / "wn_01.dat")[:, 2:7]
    found = by_method(heard, 100.0, method="modes", band_hz=(3.0, 5.0)).structural
    assert [round(mode.frequency_hz.value, 1) for mode in found] == [3.7, 4.2]
    assert all(mode.damping_ratio.value < 0.03 for mode in found)
