import dataclasses

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.builders import chain, shear_frame
from slowtime.dynamics.damping import modal_damping, rayleigh_coefficients
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.simulation import ambient_structure
from slowtime.identification.automatic.estimation import (
    _judged,
    _spectrum,
    identify_modes,
)
from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.beside_lines import MachineLines
from slowtime.identification.harmonics.narrowband import fourier_spectra
from slowtime.identification.mode_shapes.criteria import mac

RATE = 12.0
DAMPING = 0.01
PUBLISHED = np.array(
    [1.2283, 1.4358, 2.1, 4.0175, 4.7704, 6.6824, 7.6157, 9.6653, 12.1663, 12.5979, 13.8545]
)
"""Natural frequencies of the steel frame, with its measurements [Hz]."""


def row(number, *, frequencies=None):
    """Masses in a row, the first mode at 1 Hz, or all modes where they are asked for."""
    bare = assemble(chain([1.0] * number, [1.0] * number))
    modes = undamped_modes(bare)
    stiffness = bare.stiffness * (2 * np.pi / modes.angular_frequency[0]) ** 2
    if frequencies is not None:
        stiffness = modes.shapes * (2 * np.pi * np.array(frequencies)) ** 2 @ modes.shapes.T
    damping = modal_damping(bare.mass, stiffness, DAMPING)
    return dataclasses.replace(bare, stiffness=stiffness, damping=damping)


def truth(structure):
    return undamped_modes(structure).angular_frequency / (2 * np.pi)


def heard(structure, seconds, rng, *, rate=RATE, noise=0.1):
    motion = ambient_structure(structure, round(seconds * rate), rate, rng)
    return motion + noise * motion.std(axis=0) * rng.standard_normal(motion.shape)


def line(frequency, count, *, rate=RATE):
    return np.sqrt(2.0) * np.cos(2 * np.pi * frequency * np.arange(count) / rate + 1.0)


def values(modes):
    return np.array([(mode.frequency_hz.value, mode.damping_ratio.value) for mode in modes])


THREE = row(3)


@pytest.fixture(scope="module")
def record():
    motion = heard(THREE, 800.0, np.random.default_rng(1))
    return motion + 0.5 * motion.std(axis=0) * line(1.9, len(motion))[:, None]


@pytest.fixture(scope="module")
def result(record):
    return identify_modes(record, RATE)


def test_every_mode_is_found_and_nothing_else_without_a_hint(result):
    found = values(result.structural)
    assert len(found) == 3
    sd = np.array([(m.frequency_hz.sd, m.damping_ratio.sd) for m in result.structural])
    assert (np.abs(found[:, 0] - truth(THREE)) < 3.5 * sd[:, 0]).all()
    assert (np.abs(found[:, 1] - DAMPING) < 3.5 * sd[:, 1]).all()
    assert (sd[:, 0] < 2e-3 * found[:, 0]).all()
    for mode, shape in zip(result.structural, undamped_modes(THREE).shapes.T, strict=True):
        assert mac(mode.shape, shape) > 0.995
        away = mode.shape * np.exp(-1j * np.angle(np.vdot(shape, mode.shape)))
        away = away - shape / np.linalg.norm(shape) * np.vdot(shape, away) / np.vdot(
            shape, shape
        )
        assert np.linalg.norm(away) < 4 * np.linalg.norm(mode.shape_sd)


def test_the_line_of_a_machine_is_told_as_such_and_called_no_mode(result):
    (machine,) = (mode for mode in result.modes if mode.kind == "harmonic")
    assert machine.frequency_hz.value == pytest.approx(1.9, abs=1e-3)
    assert [mode.frequency_hz.value for mode in result.modes] == sorted(
        mode.frequency_hz.value for mode in result.modes
    )


def test_what_is_too_steady_for_a_structure_is_called_a_harmonic(result):
    """Whatever found it: here a line that was not taken out of the record before."""
    motion = heard(row(1), 800.0, np.random.default_rng(4))
    spectra = fourier_spectra(motion + motion.std() * line(1.9, len(motion))[:, None], RATE)
    mode, steady = (
        dataclasses.replace(result.structural[0], frequency_hz=Measured(at, 1e-3))
        for at in (1.0, 1.9)
    )
    quiet = MachineLines((), (), len(motion) / RATE)
    kinds = [one.kind for one in _judged([mode, steady], spectra, quiet)]
    assert kinds == ["structural", "harmonic"]
    assert _judged([], spectra, quiet) == []


@pytest.mark.parametrize(("at", "sd"), [(1.9, 0.0), (1.9, 0.013), (0.004, 0.02), (3.99, 0.02)])
def test_ordinates_within_two_standard_deviations_of_a_line_are_spared_and_few_more(at, sd):
    spacing = 0.005
    frequency = spacing * np.arange(800)
    spared = _spectrum(np.ones((800, 2), complex), spacing, (Measured(at, sd),)).spared
    away = np.abs(frequency - at)
    assert spared[away <= 2 * sd + spacing].all()
    assert not spared[away > 2 * sd + 4 * spacing].any()


@pytest.mark.long
def test_lines_without_a_structure_show_no_modes():
    rng = np.random.default_rng(2)
    both = line(1.3, 9000) + 0.5 * line(3.7, 9000)
    found = identify_modes(both[:, None] * [1.0, -2.0] + rng.standard_normal((9000, 2)), RATE)
    assert found.structural == ()
    np.testing.assert_allclose(
        [m.frequency_hz.value for m in found.modes], [1.3, 3.7], atol=2e-3
    )


@pytest.mark.long
def test_scale_and_order_of_the_channels_do_not_matter(record, result):
    units, order = np.array([1e-6, 3.0, 1e5]), [2, 0, 1]
    other = identify_modes((record * units)[:, order], RATE)
    sd = np.array([(m.frequency_hz.sd, m.damping_ratio.sd) for m in result.modes])
    assert (np.abs(values(other.modes) - values(result.modes)) <= 0.05 * sd + 1e-9).all()
    for mode, plain in zip(other.structural, result.structural, strict=True):
        assert mac(mode.shape, (plain.shape * units)[order]) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.long
def test_channels_that_do_not_move_are_left_out_and_have_no_part_in_a_shape(record, result):
    dead = np.column_stack([np.full(len(record), 7.0), record])
    other = identify_modes(dead, RATE)
    np.testing.assert_array_equal(values(other.modes), values(result.modes))
    for mode, plain in zip(other.modes, result.modes, strict=True):
        assert mode.shape[0] == 0.0
        assert mode.shape_sd[0] == 0.0
        np.testing.assert_array_equal(mode.shape[1:], plain.shape)


def test_channels_that_say_the_same_are_as_good_as_one():
    motion = heard(THREE, 600.0, np.random.default_rng(3))[:, :1]
    alone = identify_modes(motion[:, 0], RATE)
    again = identify_modes(np.repeat(motion, 3, axis=1), RATE)
    assert len(alone.structural) == 3
    # Three that are one leave directions of rounding alone, other ones on other machines.
    sd = np.array([(m.frequency_hz.sd, m.damping_ratio.sd) for m in alone.modes])
    assert (np.abs(values(again.modes) - values(alone.modes)) <= 0.25 * sd).all()


@pytest.mark.long
def test_the_record_is_left_as_it_was_and_tells_the_same_again(record, result):
    before = record.copy()
    again = identify_modes(record, RATE)
    np.testing.assert_array_equal(record, before)
    np.testing.assert_array_equal(values(again.modes), values(result.modes))


@pytest.mark.long
def test_two_modes_three_percent_apart_are_two():
    structure = row(4, frequencies=[1.0, 2.0, 2.06, 3.5])
    found = identify_modes(heard(structure, 1000.0, np.random.default_rng(4)), RATE)
    np.testing.assert_allclose(values(found.structural)[:, 0], truth(structure), rtol=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_noise_of_whatever_colour_shows_no_modes(seed):
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((6000, 3))
    reddish = sps.lfilter([1.0], [1.0, -0.95], white, axis=0) @ rng.standard_normal((3, 3))
    for noise in (white, reddish, np.cumsum(white, axis=0)):
        assert identify_modes(noise, 50.0).modes == ()


@pytest.mark.long
def test_a_short_window_of_a_frame_shows_all_its_modes_every_time():
    floors, storeys = [1000.0, 1000.0, 800.0], [1.2e6, 1.0e6, 0.8e6]
    omega = undamped_modes(assemble(shear_frame(floors, storeys))).angular_frequency
    ends = (float(omega[0]), float(omega[-1]))
    coefficients = rayleigh_coefficients(ends, (DAMPING, DAMPING))
    frame = assemble(shear_frame(floors, storeys, rayleigh=coefficients))
    rng = np.random.default_rng(5)
    for _ in range(4):
        found = identify_modes(heard(frame, 120.0, rng, rate=50.0), 50.0)
        assert len(found.modes) == 3
        np.testing.assert_allclose(
            values(found.structural)[:, 0], omega / (2 * np.pi), rtol=0.02
        )


@pytest.mark.long
def test_a_band_and_a_number_of_modes_are_kept_to(record, result):
    inside = identify_modes(record, RATE, band_hz=(2.0, 5.0))
    assert len(inside.structural) == 2
    np.testing.assert_allclose(
        values(inside.structural)[:, 0], values(result.structural)[1:, 0], rtol=1e-3
    )
    (strongest,) = identify_modes(record, RATE, most=1).structural
    assert strongest.frequency_hz.value in values(result.structural)[:, 0]


def test_the_diagram_shows_where_each_mode_was_seen(result):
    diagram = result.stabilisation
    for place, mode in enumerate(result.modes):
        seen = diagram.mode == place
        if mode.kind == "harmonic":
            assert not seen.any()
            continue
        assert seen.sum() >= 7
        assert (
            np.median(np.abs(diagram.frequency_hz[seen] / mode.frequency_hz.value - 1)) < 0.01
        )
    assert diagram.mode.max() < len(result.modes)
    peaks = np.interp(
        values(result.structural)[:, 0], result.spectrum_hz, result.singular_values[:, 0]
    )
    assert (peaks > 20 * np.median(result.singular_values[:, 0])).all()


def test_records_too_short_to_tell_say_so():
    noise = np.random.default_rng(6).standard_normal((60, 2))
    with pytest.raises(ValueError, match=r"40 samples at 1 Hz hold 20 cycles.*longer record"):
        identify_modes(noise[:40], 1.0)
    with pytest.raises(ValueError, match=r"20 samples were given, at least 32"):
        identify_modes(noise[:20], 1.0)
    assert identify_modes(noise, 1.0).modes == ()


@pytest.mark.slow
def test_errors_are_what_is_said_over_many_records():
    rng = np.random.default_rng(7)
    errors = []
    for _ in range(60):
        modes = identify_modes(heard(THREE, 600.0, rng), RATE).structural
        assert len(modes) == 3
        sd = np.array([(m.frequency_hz.sd, m.damping_ratio.sd) for m in modes])
        away = values(modes) - np.column_stack([truth(THREE), np.full(3, DAMPING)])
        errors.append(away / sd)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(errors), axis=(0, 1))), 1.0, atol=0.2)
    assert (np.mean(np.abs(errors) < 1.96, axis=(0, 1)) > 0.9).all()


@pytest.mark.long
@pytest.mark.data
@pytest.mark.parametrize("number", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_steel_frame_shows_its_published_modes_and_no_others(data, number):
    samples = np.load(data / "steel_frame" / f"measurement_{number}.npy")
    modes = identify_modes(samples, 256.0).structural
    away = np.abs(values(modes)[:, 0] - PUBLISHED[:, None])
    nearest = away.argmin(axis=1)
    within = away.min(axis=1) <= 0.02
    assert within.sum() >= 9
    assert len(modes) - len(set(nearest[within].tolist())) <= 1
    intervals = np.array([modes[k].frequency_hz.interval() for k in nearest])
    assert np.sum((intervals[:, 0] <= PUBLISHED) & (PUBLISHED <= intervals[:, 1])) >= 8
