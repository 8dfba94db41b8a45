"""Modes from measured inputs against the truth; intervals over seeds; measured rigs."""

import numpy as np
import pytest
import scipy.signal

from slowtime.identification.frequency_response.hits import find_hits
from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime.identification.modal_fit.blows import HammerSettings, identify_blows
from slowtime.identification.modal_fit.identification import identify_responses
from slowtime.identification.modal_fit.maximum_likelihood import fit_poles
from slowtime.identification.modal_fit.records import identify_record
from slowtime.identification.modal_fit.spectral_data import SpectralData
from tests.slowtime.identification.modal_fit.structures import (
    Structure,
    blows,
    frame,
    response_to,
)

RATE = 128.0
FRAME = frame(3)
MASSES = 1 / FRAME.shapes**2


def white(rng, count, inputs):
    sections = scipy.signal.butter(6, 40, fs=RATE, output="sos")
    return scipy.signal.sosfilt(sections, rng.standard_normal((count, inputs)), axis=0)


def ambient(rng, count, size):
    """Response to an unmeasured force at storey 3."""
    structure = Structure(
        FRAME.frequency_hz, FRAME.damping_ratio, FRAME.shapes, FRAME.shapes[[2]]
    )
    return response_to(structure, size * white(rng, count, 1), RATE)


def hammer(seed, settings=None, *, unmeasured=0.5):
    rng = np.random.default_rng(seed)
    at = 1 + 8 * np.arange(5) + rng.uniform(0, 0.3, 5)
    force = blows(at, rng.uniform(80, 120, 5), RATE, 42.0, 0.02)
    y = response_to(FRAME, np.column_stack([force, 0 * force]), RATE)
    y = y + ambient(rng, len(y), unmeasured) + 0.2 * rng.standard_normal(y.shape)
    force = force + 0.02 * rng.standard_normal(force.shape)
    hits = find_hits(force, y, RATE)
    return identify_blows(
        force, y, RATE, hits, band_hz=(1.0, 14.0), settings=settings, driving_points=[(2, 0)]
    )


def shakers(seed, source="both", seconds=60.0):
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    u = white(rng, count + 1000, 2)
    y = (response_to(FRAME, u, RATE) + ambient(rng, len(u), 0.3))[1000:]
    y = y + 0.05 * y.std() * rng.standard_normal(y.shape)
    return identify_record(
        u[1000:], y, RATE, kind="acceleration", band_hz=(1.0, 14.0), source=source,
        driving_points=[(2, 0), (1, 1)],
    )  # fmt: skip


BUILDING = Structure(
    np.array([1.2, 3.5, 5.6]), np.array([0.03, 0.025, 0.03]), FRAME.shapes, FRAME.shapes[[2]]
)
SUPPORTS = np.stack(
    [0.6 * FRAME.shapes.sum(axis=0), 0.4 * FRAME.shapes.sum(axis=0) + [0.02, 0.05, -0.04]]
)


def earthquake(seed, source="subspace"):
    """Two supports that move alike in part, and a building over them."""
    rng = np.random.default_rng(seed)
    rate, count = 50.0, 3000
    time = np.arange(count) / rate
    sections = scipy.signal.butter(6, 18, fs=rate, output="sos")
    ground = scipy.signal.sosfilt(sections, rng.standard_normal((count, 2)), axis=0)
    ground[:, 1] = 0.6 * ground[:, 0] + 0.8 * ground[:, 1]
    ground *= (time / 8 * np.exp(1 - time / 8))[:, None]
    y = response_to(BUILDING, ground, rate, factors=SUPPORTS)
    return identify_record(
        ground + 0.002 * rng.standard_normal(ground.shape),
        y + 0.02 * rng.standard_normal(y.shape),
        rate, kind="transmissibility", band_hz=(0.4, 9.0), source=source,
    )  # fmt: skip


def deviations(found, structure):
    """Errors of frequency and damping over their standard deviations."""
    modes = found.result.modes
    assert len(modes) == len(structure.frequency_hz)
    return np.array(
        [
            [
                (m.frequency_hz.value - f) / m.frequency_hz.sd,
                (m.damping_ratio.value - z) / m.damping_ratio.sd,
            ]
            for m, f, z in zip(
                modes, structure.frequency_hz, structure.damping_ratio, strict=True
            )
        ]
    )


@pytest.mark.parametrize(
    ("found", "structure"),
    [
        (lambda: hammer(1), FRAME),
        (lambda: shakers(1), FRAME),
        (lambda: shakers(1, "polyreference"), FRAME),
        (lambda: earthquake(1), BUILDING),
        (lambda: earthquake(1, "polyreference"), BUILDING),
    ],
    ids=["hammer", "shakers", "shakers-plscf", "earthquake", "earthquake-plscf"],
)
def test_all_modes_are_found_within_their_errors(found, structure):
    result = found()
    assert np.abs(deviations(result, structure)).max() < 4.5
    for k, mode in enumerate(result.result.modes):
        true = structure.shapes[:, k] / np.linalg.norm(structure.shapes[:, k])
        assert 1 - abs(np.vdot(true, mode.shape)) ** 2 < 2e-3
        assert mode.frequency_hz.sd < 0.02 * mode.frequency_hz.value


def test_a_driving_point_gives_the_modal_mass():
    for k, constants in enumerate(hammer(2).constants):
        mass = constants.modal_mass
        assert constants.driving_point == (2, 0)
        assert abs(mass.value - MASSES[2, k]) < 5 * mass.sd < 0.2 * MASSES[2, k]
    for k, constants in enumerate(shakers(3).constants):
        storey = constants.driving_point[0]
        assert abs(constants.modal_mass.value - MASSES[storey, k]) < 5 * constants.modal_mass.sd


def test_participation_is_the_deflection_where_the_inputs_act():
    for k, constants in enumerate(shakers(4).constants):
        true = FRAME.forces[:, k] / FRAME.forces[np.argmax(np.abs(FRAME.forces[:, k])), k]
        np.testing.assert_allclose(constants.participation, true, atol=0.03)


def test_an_exponential_window_leaves_frequency_and_damping_as_they_are():
    """Blocks begin at rest here: damping is 5 % and blows are 8 s apart."""
    rng = np.random.default_rng(5)
    structure = frame(3, damping=0.05)
    force = blows(1 + 8.0 * np.arange(5), np.full(5, 100.0), RATE, 42.0, 0.02)
    y = response_to(structure, np.column_stack([force, 0 * force]), RATE)
    y = y + 0.05 * rng.standard_normal(y.shape)
    hits = find_hits(force, y, RATE)
    found = identify_blows(
        force, y, RATE, hits, band_hz=(1.0, 14.0), settings=HammerSettings(decay_rate=1.0)
    )
    assert np.abs(deviations(found, structure)).max() < 4.5
    assert found.chi_square_ratio == pytest.approx(1.0, abs=0.4)


def responses(seed, noise, *, structure=FRAME):
    rng = np.random.default_rng(seed)
    hz = np.arange(1, 601) * 0.025
    true = structure.acceleration(2j * np.pi * hz)
    sd = np.full(true.shape, noise * np.median(np.abs(true)))
    error = rng.standard_normal(true.shape) + 1j * rng.standard_normal(true.shape)
    return FrequencyResponse(
        frequency_hz=hz,
        response=true + sd * error / np.sqrt(2),
        sd=sd,
        coherence=np.ones(true.shape[:2]),
        averages=10,
        kind="acceleration",
    )


def test_frequency_responses_without_noise_give_exact_modes():
    found = identify_responses(responses(1, 1e-6), band_hz=(1.0, 15.0))
    for mode, f, z in zip(
        found.result.modes, FRAME.frequency_hz, FRAME.damping_ratio, strict=True
    ):
        assert mode.frequency_hz.value == pytest.approx(f, rel=1e-6)
        assert mode.damping_ratio.value == pytest.approx(z, rel=1e-4)


def test_close_modes_with_distinct_shapes_are_both_found():
    close = Structure(
        np.array([5.0, 5.06, 9.0]), np.full(3, 0.01), FRAME.shapes, FRAME.shapes[[2, 1]]
    )
    found = identify_responses(responses(2, 0.02, structure=close))
    assert np.abs(deviations(found, close)).max() < 4.5


def test_a_misfit_is_flagged_and_widens_the_errors():
    """Errors that are stated ten times too small."""
    good = responses(3, 0.05)
    bad = FrequencyResponse(
        frequency_hz=good.frequency_hz, response=good.response, sd=good.sd / 10,
        coherence=good.coherence, averages=10, kind="acceleration",
    )  # fmt: skip
    first, second = (identify_responses(one).result.modes for one in (good, bad))
    near = [
        min(second, key=lambda m: abs(m.frequency_hz.value - f)) for f in FRAME.frequency_hz
    ]
    assert all("misfit" in mode.flags for mode in near)
    assert not any(mode.flags for mode in first)
    assert near[0].frequency_hz.sd == pytest.approx(first[0].frequency_hz.sd, rel=0.3)


def test_noise_alone_has_no_mode():
    quiet = responses(4, 1.0)
    rng = np.random.default_rng(4)
    error = rng.standard_normal(quiet.response.shape) + 1j * rng.standard_normal(
        quiet.response.shape
    )
    nothing = FrequencyResponse(
        frequency_hz=quiet.frequency_hz, response=quiet.sd * error, sd=quiet.sd * np.sqrt(2),
        coherence=quiet.coherence, averages=10, kind="acceleration",
    )  # fmt: skip
    assert identify_responses(nothing).result.modes == ()


def test_derivatives_by_the_poles_are_those_of_differences():
    """Standard deviations of one entry are those of a numerical Fisher information."""
    measured = responses(5, 0.05)
    data = SpectralData(
        s=measured.s, values=measured.response[:, 0, :1], sd=measured.sd[:, 0, :1],
        inputs=np.ones((600, 1), complex), ends=np.zeros((600, 0), complex),
        kind="acceleration",
    )  # fmt: skip
    fit = fit_poles(data, FRAME.poles)
    step = 1e-3 * np.concatenate([np.abs(fit.poles.real)] * 2)
    curvature = np.zeros((6, 6))

    def cost(move):
        moved = fit.poles + move[:3] + 1j * move[3:]
        return fit_poles(data, moved, rounds=0).chi_square

    unit = np.diag(step)
    for a in range(6):
        for b in range(6):
            corners = [
                cost(x * unit[a] + y * unit[b]) for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
            curvature[a, b] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                4 * step[a] * step[b]
            )
    sd = np.sqrt(np.diag(np.linalg.inv(curvature / 2)))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), sd, rtol=0.1)


@pytest.mark.long
@pytest.mark.parametrize("find", [hammer, shakers], ids=["hammer", "shakers"])
def test_intervals_hold_over_seeds(find):
    found = [find(seed) for seed in range(100)]
    whole = [one for one in found if len(one.result.modes) == 3]
    assert len(whole) >= 97
    covered = (np.abs([deviations(one, FRAME) for one in whole]) < 1.96).mean(axis=(0, 1))
    assert 0.91 < covered[0] < 0.98
    assert 0.90 < covered[1] < 0.98


@pytest.mark.long
def test_intervals_hold_over_earthquakes():
    whole = [deviations(earthquake(seed), BUILDING) for seed in range(60)]
    covered = (np.abs(whole) < 1.96).mean(axis=(0, 1))
    assert covered.min() > 0.88


@pytest.mark.data
def test_a_measured_frame_gives_its_known_modes(data):
    """Force on floor 2 of the three-storey frame: 6.50, 17.47 Hz and masses of 4.85 kg."""
    path = data / "three_storey_frf/test_2.csv"
    if not path.exists():
        pytest.skip("three_storey_frf is not in SLOWTIME_DATA")
    rows = [line.strip().split(";") for line in path.read_text().splitlines() if line.strip()]
    table = np.array([[complex(one) for one in row[:4]] for row in rows])
    missing = np.full((len(table), 3, 1), np.nan)
    measured = FrequencyResponse(
        frequency_hz=table[:, 0].real, response=table[:, 1:, None], sd=missing,
        coherence=missing[:, :, 0], averages=1, kind="acceleration",
    )  # fmt: skip
    found = identify_responses(measured, band_hz=(3.0, 40.0), driving_points=[(1, 0)])
    hz = [mode.frequency_hz.value for mode in found.result.modes]
    for known in (6.50, 17.47):
        assert min(abs(one - known) for one in hz) < 0.02
    at = int(np.argmin(np.abs(np.array(hz) - 6.5)))
    shape = np.real(found.result.modes[at].shape)
    mass = found.constants[at].modal_mass
    assert mass is not None
    # Of unit deflection at floor 2: storeys of 4.85 kg.
    assert mass.value == pytest.approx(4.85 * np.sum(shape**2) / shape[1] ** 2, rel=0.1)


@pytest.mark.data
@pytest.mark.long
def test_a_measured_tower_gives_its_known_modes(data):
    """A mass damper shakes five storeys: 0.51-0.53, 1.75-1.77, 2.8-3.1, 4.1-4.5, 5.4-5.5 Hz."""
    path = data / "unison_tower/wn_01.dat"
    if not path.exists():
        pytest.skip("unison_tower is not in SLOWTIME_DATA")
    table = np.loadtxt(path)
    found = identify_record(
        table[:, [1]], table[:, 2:7], 100.0, kind="acceleration", band_hz=(0.3, 7.0)
    )
    hz = np.array([mode.frequency_hz.value for mode in found.result.modes])
    for low, high in ((0.51, 0.535), (1.74, 1.77), (2.8, 3.1), (4.1, 4.5), (5.33, 5.5)):
        assert ((hz > low) & (hz < high)).any()
    assert len(hz) <= 10
