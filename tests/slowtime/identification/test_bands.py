"""A band selects what is reported: a mode inside does not depend on where the edges are."""

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.ambient.estimation import identify_ambient
from slowtime.identification.methods import by_method
from slowtime.identification.single_mode.estimation import all_modes, first_mode

RATE = 40.0
NATURAL_HZ, DAMPING = (2.0, 2.6, 5.0, 9.0), (0.01, 0.02, 0.01, 0.015)
STRENGTH = (1.0, 8.0, 1.0, 4.0)
"""The modes beside a band are the stronger ones."""
SHAPES = np.array([[1.0, 0.4, 0.9, 1.0], [0.6, 1.0, -0.8, 0.3], [0.3, 0.8, -0.7, -1.0]])
BANDS = 20


def record(seed):
    rng, count = np.random.default_rng(seed), 16_000
    samples = 0.05 * rng.standard_normal((count, 3))
    for hz, zeta, strength, shape in zip(NATURAL_HZ, DAMPING, STRENGTH, SHAPES.T, strict=True):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, zeta), count, RATE, rng)
        samples = samples + np.outer(strength * ringing / ringing.std(), shape)
    return samples


def bands_about(mode, rng, number, highest_hz):
    """Bands that contain the half-power band of a mode, edges close to it among them."""
    hz = mode.frequency_hz.value
    width = hz * float(np.nan_to_num(mode.damping_ratio.value, nan=0.01))
    for _ in range(number):
        below, above = np.exp(rng.uniform(0.0, np.log(20.0), 2)) * max(width, 0.02)
        yield max(hz - below, 0.2 * hz), min(hz + above, highest_hz)


def departures(whole, of_band, *, number, highest_hz, seed=0):
    """Shifts of frequency and damping under bands [sd of the mode without a band]."""
    rng, found = np.random.default_rng(seed), []
    for mode in whole:
        for band_hz in bands_about(mode, rng, number, highest_hz):
            modes = of_band(band_hz)
            hz = mode.frequency_hz.value
            assert all(band_hz[0] <= m.frequency_hz.value <= band_hz[1] for m in modes)
            assert modes, f"no mode in {band_hz}, which contains {hz:g} Hz"
            same = min(modes, key=lambda m: abs(m.frequency_hz.value - hz))
            found.append((same.frequency_hz.value - hz) / mode.frequency_hz.sd)
            if np.isfinite(mode.damping_ratio.sd):
                off = same.damping_ratio.value - mode.damping_ratio.value
                found.append(off / mode.damping_ratio.sd)
    return np.abs(found)


def holds(away):
    return away.max() <= 1.0 and np.mean(away <= 0.5) >= 0.95


@pytest.mark.parametrize("method", ["modes", "bayes", "fdd", "efdd"])
def test_modes_of_all_channels_do_not_depend_on_the_edges(method):
    samples = record(1)
    whole = by_method(samples, RATE, method=method).structural
    assert len(whole) >= 3

    def of_band(band_hz):
        return by_method(samples, RATE, method=method, band_hz=band_hz).structural

    number = 1 if method == "bayes" else 2
    assert holds(departures(whole, of_band, number=number, highest_hz=0.45 * RATE))


@pytest.mark.parametrize("method", ["auto", "ambient", "free_decay"])
def test_modes_one_by_one_do_not_depend_on_the_edges(method):
    samples = record(2)
    if method == "free_decay":
        seconds = np.arange(len(samples))[:, None] / RATE
        rings = [
            amplitude * np.exp(-2 * np.pi * z * f * seconds) * np.cos(2 * np.pi * f * seconds)
            for f, z, amplitude in zip(NATURAL_HZ, DAMPING, STRENGTH, strict=True)
        ]
        samples = sum(rings) + 1e-3 * np.random.default_rng(3).standard_normal(seconds.shape)
    whole = all_modes(samples, RATE, method=method)
    assert len(whole) >= 2

    def of_band(band_hz):
        return all_modes(samples, RATE, method=method, band_hz=band_hz)

    assert holds(departures(whole, of_band, number=3, highest_hz=0.45 * RATE))


def test_the_lowest_mode_of_a_band_is_that_of_all_modes():
    samples = record(4)
    for mode in all_modes(samples, RATE):
        hz = mode.frequency_hz.value
        first = first_mode(samples, RATE, band_hz=(0.97 * hz, 1.2 * hz))
        assert first is not None
        assert abs(first.frequency_hz.value - hz) <= 0.5 * mode.frequency_hz.sd


def test_the_strongest_resonance_of_a_band_keeps_the_band_of_its_fit():
    samples = record(5)
    one, other = (
        identify_ambient(samples, RATE, band_hz=band_hz) for band_hz in ((4.5, 5.5), (3.2, 7.0))
    )
    assert other.frequency_hz.value == pytest.approx(one.frequency_hz.value, rel=1e-9)
    assert other.damping_ratio.value == pytest.approx(one.damping_ratio.value, rel=1e-9)


def test_a_strong_mode_outside_puts_nothing_into_the_band():
    rng, count = np.random.default_rng(6), 16_000
    ringing = ambient_acceleration(Oscillator.from_modal(5.0, 0.01), count, RATE, rng)
    samples = ringing[:, None] / ringing.std() * [1.0, 0.7]
    samples = samples + 0.01 * rng.standard_normal(samples.shape)
    for band_hz in ((0.5, 4.8), (1.0, 4.5), (5.2, 15.0)):
        assert all_modes(samples, RATE, band_hz=band_hz) == ()
        for method in ("modes", "efdd"):
            assert by_method(samples, RATE, method=method, band_hz=band_hz).modes == ()


def test_edges_below_twenty_cycles_or_near_half_the_rate_add_only():
    samples = record(7)
    usual = by_method(samples, RATE, method="modes").modes
    wider = by_method(samples, RATE, method="modes", band_hz=(0.03, 19.5)).modes
    assert len(wider) >= len(usual)
    for mode in usual:
        hz = mode.frequency_hz
        assert min(abs(m.frequency_hz.value - hz.value) for m in wider) <= 0.5 * hz.sd


@pytest.mark.long
@pytest.mark.parametrize("name", ["wn_01", "wn_02"])
def test_modes_of_a_measured_tower_do_not_depend_on_the_edges(data, name):
    samples = np.loadtxt(data / "unison_tower" / f"{name}.dat")[:, 1:7]
    whole = by_method(samples, 100.0, method="modes").structural
    lowest = [mode for mode in whole if mode.frequency_hz.value < 7.0]
    assert len(lowest) >= 3

    def of_band(band_hz):
        return by_method(samples, 100.0, method="modes", band_hz=band_hz).structural

    number = BANDS // len(lowest) + 1
    assert holds(departures(lowest, of_band, number=number, highest_hz=45.0))
