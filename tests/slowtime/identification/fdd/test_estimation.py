"""Frequency domain decomposition: peaks nobody picked, and errors that hold."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.ambient.expected_spectrum import expected_resonance
from slowtime.identification.fdd.correlation_decay import fit_correlation_decay
from slowtime.identification.fdd.estimation import efdd, fdd
from slowtime.identification.fdd.spectral_decomposition import (
    decompose_spectrum,
    ordinates_about,
    scaled_coefficients,
)
from slowtime.identification.harmonics.detection import find_harmonics
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.single_mode.bounds import ambient_law

RATE = 50.0
FREQUENCIES = (2.0, 5.0, 11.0)
SHAPES = np.array([[1.0, 0.9, 0.8], [0.6, -0.8, -0.9], [0.3, -0.7, 1.0]])


def record(seed, *, seconds=400.0, damping=0.01, frequencies=FREQUENCIES, noise=0.1):
    """Modes of three channels under forces of their own."""
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    whole = np.zeros((count, 3))
    for hz, shape in zip(frequencies, SHAPES.T, strict=False):
        oscillator = Oscillator.from_modal(hz, damping)
        whole += np.outer(ambient_acceleration(oscillator, count, RATE, rng), shape)
    return whole + noise * whole.std(axis=0) * rng.standard_normal(whole.shape)


def errors(method, runs, *, damping=0.01, seconds=400.0, hz=5.0):
    """Errors over their sd, of frequency and damping, and of frequency over the law."""
    of_f, of_z, over_law = [], [], []
    law = hz * ambient_law(damping, hz * seconds)[0]
    for seed in range(runs):
        samples = record(seed, seconds=seconds, damping=damping, frequencies=(hz,))
        (mode,) = method(samples, RATE)
        off = mode.frequency_hz.value - hz
        of_f.append(off / mode.frequency_hz.sd)
        over_law.append(off / law)
        of_z.append((mode.damping_ratio.value - damping) / mode.damping_ratio.sd)
    return np.array(of_f), np.array(of_z), np.array(over_law)


def test_every_peak_is_found_and_nothing_else():
    for method in (fdd, efdd):
        modes = method(record(1), RATE)
        assert len(modes) == 3
        for mode, hz, shape in zip(modes, FREQUENCIES, SHAPES.T, strict=True):
            assert abs(mode.frequency_hz.value - hz) < 4 * mode.frequency_hz.sd
            assert mode.frequency_hz.sd < 0.005 * hz
            assert mac(mode.shape, shape) > 0.99


@pytest.mark.long
@pytest.mark.parametrize("colour", [0.0, 0.9, -0.7])
def test_noise_has_no_modes(colour):
    found = 0
    for seed in range(6):
        white = np.random.default_rng(seed).standard_normal((20_000, 3))
        found += len(fdd(sps.lfilter([1.0], [1.0, -colour], white, axis=0), RATE))
    assert found <= 1


@pytest.mark.long
@pytest.mark.parametrize("method", [fdd, efdd])
def test_a_few_frequencies_and_dampings_are_as_near_as_they_say(method):
    of_f, of_z, over_law = errors(method, 8)
    assert 0.3 < np.sqrt(np.mean(of_f**2)) < 1.7
    assert np.sqrt(np.mean(over_law**2)) < 2.6
    if method is efdd:
        assert 0.3 < np.sqrt(np.mean(of_z**2)) < 1.7


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("method", [fdd, efdd])
def test_intervals_hold(method, damping):
    of_f, of_z, over_law = errors(method, 200, damping=damping)
    assert np.mean(np.abs(of_f) < 1.96) > 0.86
    assert np.sqrt(np.mean(over_law**2)) < 2.4
    if method is efdd:
        assert np.mean(np.abs(of_z) < 1.96) > 0.87
        assert abs(np.mean(of_z)) < 0.3


@pytest.mark.long
def test_shapes_are_off_by_as_much_as_they_say():
    off, said = [], []
    for seed in range(12):
        mode = fdd(record(seed, frequencies=FREQUENCIES[:1]), RATE)[0]
        assert np.linalg.norm(mode.shape) == pytest.approx(1.0)
        largest = np.argmax(np.abs(mode.shape))
        assert mode.shape[largest].real > 0
        assert mode.shape[largest].imag == pytest.approx(0.0, abs=1e-12)
        unit = SHAPES[:, 0] / np.linalg.norm(SHAPES[:, 0])
        turned = unit * np.sign(unit[largest])
        off.append(np.abs(mode.shape - turned) ** 2)
        said.append(mode.shape_sd**2)
    ratio = np.mean(off, axis=0) / np.mean(said, axis=0)
    assert (ratio > 0.3).all()
    assert (ratio < 2.5).all()


def test_a_second_mode_nearer_than_the_resolution_needs_a_finer_one():
    samples = record(3, seconds=4000.0, damping=0.002, frequencies=(5.0, 5.06))
    assert len(fdd(samples, RATE, resolution=0.02)) == 1
    assert len(fdd(samples, RATE, resolution=0.003)) == 2


def test_the_line_of_a_machine_is_a_peak_until_it_is_taken_out():
    samples = record(4)
    tone = np.sin(2 * np.pi * 7.77 * np.arange(len(samples)) / RATE)
    heard = samples + samples.std() * tone[:, None]
    assert len(fdd(heard, RATE)) == 4
    lines = tuple(line.frequency_hz for line in find_harmonics(heard, RATE)[0])
    without = efdd(heard, RATE, lines=lines)
    for mode, hz in zip(without, FREQUENCIES, strict=True):
        assert abs(mode.frequency_hz.value - hz) < 4 * mode.frequency_hz.sd
        assert abs(mode.damping_ratio.value - 0.01) < 4 * mode.damping_ratio.sd


def test_the_plain_method_says_nothing_of_damping():
    for mode in fdd(record(5), RATE):
        assert np.isnan([mode.damping_ratio.value, mode.damping_ratio.sd]).all()
        assert mode.flags == ("no_damping",)


def test_units_and_dead_channels_change_shapes_alone():
    samples = record(6)
    units = np.array([1.0, 1e-3, 20.0])
    heard = np.insert(samples * units, 1, 7.0, axis=1)
    for one, other in zip(efdd(samples, RATE), efdd(heard, RATE), strict=True):
        assert other.frequency_hz.value == pytest.approx(one.frequency_hz.value, rel=1e-9)
        assert other.damping_ratio.sd == pytest.approx(one.damping_ratio.sd, rel=1e-6)
        assert other.shape[1] == 0
        assert mac(other.shape[[0, 2, 3]], one.shape * units) == pytest.approx(1.0)


def test_singular_values_are_those_of_the_weighted_spectral_matrix():
    data = scaled_coefficients(record(7, seconds=100.0), RATE)
    found = decompose_spectrum(data, band_hz=(4.0, 6.0))
    for k in (0, len(found.values) // 2, len(found.values) - 1):
        place = found.frequency_hz[k]
        near, w = ordinates_about(data, place, data.half_width_hz(place, 0.01))
        columns = np.sqrt(w / w.sum())[:, None] * data.coefficients[near]
        expected = np.linalg.svd(columns, compute_uv=False) ** 2
        np.testing.assert_allclose(found.values[k], expected, rtol=1e-9)
        left = np.linalg.svd(columns.T)[0][:, 0]
        assert mac(found.vectors[k], left) == pytest.approx(1.0)


@pytest.mark.parametrize("reach", [(6.0, 6.0), (25.0, 25.0), (4.0, 12.0)])
@pytest.mark.parametrize("floor", [0.0, 0.02])
def test_of_an_expected_bell_the_pole_is_exact(reach, floor):
    count, hz, damping = 20_000, 5.0, 0.01
    bins = np.arange(count // 2) * RATE / count
    low, high = hz * (1 - reach[0] * damping), hz * (1 + reach[1] * damping)
    bins = bins[(bins >= low) & (bins <= high)]
    bell = expected_resonance(
        bins, natural_hz=hz, damping_ratio=damping, rate_hz=RATE, count=count
    )
    found = fit_correlation_decay(bins, bell + floor, centre_hz=hz, rate_hz=RATE, count=count)
    assert found is not None
    assert found.frequency_hz.value == pytest.approx(hz, rel=1e-5)
    assert found.damping_ratio.value == pytest.approx(damping, rel=5e-3)


def test_a_bell_without_flanks_is_flagged():
    count, hz, damping = 20_000, 5.0, 0.01
    bins = np.arange(count // 2) * RATE / count
    bins = bins[np.abs(bins - hz) < 3 * damping * hz]
    bell = expected_resonance(
        bins, natural_hz=hz, damping_ratio=damping, rate_hz=RATE, count=count
    )
    found = fit_correlation_decay(bins, bell, centre_hz=hz, rate_hz=RATE, count=count)
    assert found is None or "narrow_bell" in found.flags


def test_too_short_a_record_says_so():
    with pytest.raises(ValueError, match="Give a longer record"):
        fdd(np.random.default_rng(1).standard_normal((40, 2)), RATE)
