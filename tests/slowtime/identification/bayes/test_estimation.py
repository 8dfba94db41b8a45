"""Modes by the fast Bayesian FFT: as exact as the law allows, and as sure as they say."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Structure
from slowtime.identification.bayes import bayesian_modes
from slowtime.identification.bayes.band import Band
from slowtime.identification.bayes.likelihood import coherence_score
from slowtime.identification.bayes.model import BandModes
from slowtime.identification.bayes.resonances import cross_periodograms
from slowtime.identification.harmonics.detection import find_harmonics
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.single_mode.bounds import ambient_law

DAMPING = 0.01
CYCLES = 2000


@dataclasses.dataclass(frozen=True)
class Case:
    """Unit masses in a row with the frequencies given, first at 1 Hz."""

    frequency_hz: tuple[float, ...]
    rate_hz: float
    line_hz: float
    heard: tuple[int, ...]

    @property
    def structure(self):
        shapes, omega = self.all_shapes, 2 * np.pi * np.array(self.frequency_hz)
        return Structure(
            mass=np.eye(len(omega)),
            damping=shapes * (2 * DAMPING * omega) @ shapes.T,
            stiffness=shapes * omega**2 @ shapes.T,
        )

    @property
    def all_shapes(self):
        number = len(self.frequency_hz)
        stiffness = 2 * np.eye(number) - np.eye(number, k=1) - np.eye(number, k=-1)
        stiffness[-1, -1] = 1.0
        return scipy.linalg.eigh(stiffness)[1]

    @property
    def shapes(self):
        return self.all_shapes[list(self.heard)]

    @property
    def law(self):
        """Least sd of each frequency [Hz]."""
        return np.array([f * ambient_law(DAMPING, CYCLES * f)[0] for f in self.frequency_hz])

    def record(self, rng, *, cycles=CYCLES, line=True, force_psd=1.0):
        structure, count = self.structure, round(cycles * self.rate_hz)
        names = [structure.names[i] for i in self.heard]
        moved = ambient_structure(
            structure, count, self.rate_hz, rng, channels=names, force_psd=force_psd
        )
        sd = moved.std(axis=0)
        noise = 0.1 * sd * rng.standard_normal(moved.shape)
        if not line:
            return moved + noise
        turn = 2 * np.pi * self.line_hz * np.arange(count) / self.rate_hz
        phase = rng.uniform(0, 2 * np.pi, len(sd))
        return moved + noise + 0.7 * sd * np.cos(turn[:, None] + phase)


def row(number):
    odd = np.sin((2 * np.arange(1, number + 1) - 1) * np.pi / (4 * number + 2))
    return tuple(odd / odd[0])


CASES = {
    "3 DOF": Case(row(3), 12.0, 1.9, (0, 1, 2)),
    "6 DOF, two 3 % apart": Case((1.0, 2.1, 3.3, 3.399, 4.4, 5.6), 16.0, 2.7, tuple(range(6))),
    "6 DOF, two 1 % apart": Case((1.0, 2.1, 3.3, 3.333, 4.4, 5.6), 16.0, 2.7, tuple(range(6))),
    "12 DOF, 4 sensors": Case(row(12), 40.0, 5.5, (2, 5, 8, 11)),
}


def tally(case, seeds, **record):
    """Errors over the law, and over the errors that the modes say they have, of f and zeta."""
    over_law, of_f, of_z = [], [], []
    truth = np.array(case.frequency_hz)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        samples = case.record(rng, **record)
        lines = find_harmonics(samples, case.rate_hz)[0]
        candidates = truth * (1 + 0.5 * DAMPING * rng.uniform(-1, 1, len(truth)))
        tones = tuple(line.frequency_hz for line in lines)
        modes = bayesian_modes(samples, case.rate_hz, candidates, lines=tones)
        assert len(modes) == len(truth)
        f, z = ([getattr(m, name) for m in modes] for name in ("frequency_hz", "damping_ratio"))
        off = np.array([m.value for m in f]) - truth
        over_law.append(off / case.law)
        of_f.append(off / [m.sd for m in f])
        of_z.append([(m.value - DAMPING) / m.sd for m in z])
    return np.array(over_law), np.array(of_f), np.array(of_z)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("3 DOF", 4),
        pytest.param("6 DOF, two 3 % apart", 2, marks=pytest.mark.slow),
        ("6 DOF, two 1 % apart", 1),
    ],
)
def test_a_few_records_are_as_near_as_they_say(name, runs):
    over_law, of_f, of_z = tally(CASES[name], range(runs))
    assert np.abs(of_f).max() < 3.5
    assert np.abs(of_z).max() < 3.5
    assert 0.5 < np.sqrt(np.mean(over_law**2)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "runs"),
    [("3 DOF", 200), ("6 DOF, two 3 % apart", 100), ("12 DOF, 4 sensors", 100)],
)
def test_errors_are_near_the_law_and_intervals_hold(name, runs):
    over_law, of_f, of_z = tally(CASES[name], range(1000, 1000 + runs))
    assert np.sqrt(np.mean(over_law**2)) <= 1.15
    assert 0.92 <= np.mean(np.abs(of_f) < 1.96) <= 0.97
    assert 0.90 <= np.mean(np.abs(of_z) < 1.96) <= 0.98


@pytest.mark.slow
def test_modes_that_one_force_drives_keep_their_intervals():
    case = CASES["6 DOF, two 3 % apart"]
    force = np.zeros(6)
    force[2] = 1.0
    _, of_f, of_z = tally(case, range(60), force_psd=force, line=False)
    assert 0.90 <= np.mean(np.abs(of_f) < 1.96) <= 0.98
    assert 0.88 <= np.mean(np.abs(of_z) < 1.96) <= 0.98


def drawn(rng, modes, *, bins=400, spacing_hz=1 / 400):
    """Coefficients of modes whose spectral matrices hold exactly."""
    centre = np.exp(modes.log_frequency).mean()
    at = np.round(centre / spacing_hz) + np.arange(bins) - bins // 2
    empty = np.zeros((bins, len(modes.shapes), len(modes.shapes)), dtype=complex)
    band = Band(at * spacing_hz, empty, np.ones(bins), 1 / spacing_hz)
    crossed = cross_periodograms(band, modes.log_frequency, modes.log_damping)
    rung = modes.shapes @ (crossed * modes.coherence) @ modes.shapes.T
    roots = np.linalg.cholesky(rung + np.diag(np.exp(modes.log_noise)))
    white = rng.standard_normal((bins, len(modes.shapes), 2)) @ [1.0, 1.0j] / np.sqrt(2.0)
    columns = np.einsum("kcd,kd->kc", roots, white)
    return dataclasses.replace(band, scatter=columns[:, :, None] * columns[:, None, :].conj())


def pair(coherence):
    shapes = np.array([[1.0, 0.8], [0.7, -0.9], [0.4, 0.5]])
    root = np.array([[1.0, 0.0], [coherence, np.sqrt(1 - coherence**2)]], dtype=complex)
    return BandModes(
        log_frequency=np.log([3.0, 3.15]),
        log_damping=np.log([0.01, 0.012]),
        shapes=shapes,
        mixing=root,
        log_noise=np.log([1e-3, 1e-3, 2e-3]),
        noise_exponent=np.zeros(3),
    )


@pytest.mark.long
def test_the_score_of_coherence_is_chi_squared_where_forces_have_nothing_in_common():
    rng, alone = np.random.default_rng(1), pair(0.0)
    scores = np.array([coherence_score(drawn(rng, alone), alone) for _ in range(200)])
    assert (scores[:, 1] == 2).all()
    # Mean 2 and variance 4, but for what the other parameters would have taken.
    assert scores[:, 0].mean() == pytest.approx(2.0, abs=0.45)


def test_the_score_of_coherence_is_large_where_one_force_drives_both():
    rng, alone = np.random.default_rng(2), pair(0.0)
    assert coherence_score(drawn(rng, pair(0.95)), alone)[0] > 50.0


@pytest.fixture(scope="module")
def short():
    """A record of three modes, and its modes."""
    case = CASES["3 DOF"]
    samples = case.record(np.random.default_rng(7), cycles=500, line=False)
    return case, samples, bayesian_modes(samples, case.rate_hz, np.array(case.frequency_hz))


def close(one, other):
    for a, b in zip(one, other, strict=True):
        for name in ("frequency_hz", "damping_ratio"):
            old, new = getattr(a, name), getattr(b, name)
            assert new.value == pytest.approx(old.value, abs=0.1 * old.sd)
            assert new.sd == pytest.approx(old.sd, rel=5e-2)


@pytest.mark.long
def test_shapes_are_of_unit_norm_and_off_by_as_much_as_they_say(short):
    case, _, modes = short
    for mode in modes:
        assert np.linalg.norm(mode.shape) == pytest.approx(1.0)
        assert mode.shape[np.argmax(np.abs(mode.shape))] > 0
    off, said = [], []
    for seed in range(5):
        samples = case.record(np.random.default_rng(seed), cycles=500, line=False)
        modes = bayesian_modes(samples, case.rate_hz, np.array(case.frequency_hz))
        off += [1 - mac(m.shape, true) for m, true in zip(modes, case.shapes.T, strict=True)]
        said += [np.sum(mode.shape_sd**2) for mode in modes]
    # Twice the ratio is chi-squared with two degrees of freedom, each.
    assert 0.5 < np.mean(np.array(off) / said) < 1.8


def test_units_of_channels_change_shapes_alone(short):
    case, samples, modes = short
    units = np.array([1.0, 1e3, 1e-2])
    again = bayesian_modes(samples * units, case.rate_hz, np.array(case.frequency_hz))
    close(modes, again)
    for one, other in zip(modes, again, strict=True):
        assert mac(one.shape * units, other.shape) == pytest.approx(1.0, abs=1e-6)


def test_a_channel_that_does_not_move_has_no_part_in_the_shape(short):
    case, samples, modes = short
    dead = np.insert(samples, 1, 5.0, axis=1)
    again = bayesian_modes(dead, case.rate_hz, np.array(case.frequency_hz))
    close(modes, again)
    for mode in again:
        assert mode.shape[1] == 0
        assert mode.shape_sd[1] == 0


def test_the_order_of_candidates_and_their_places_hardly_matter(short):
    case, samples, modes = short
    moved = np.array(case.frequency_hz)[::-1] * 1.004
    close(modes, bayesian_modes(samples, case.rate_hz, moved))


def test_velocities_give_the_modes_that_accelerations_give(short):
    case, samples, modes = short
    count = len(samples)
    omega = 2j * np.pi * np.fft.rfftfreq(count, 1 / case.rate_hz)
    omega[0] = 1.0
    velocity = np.fft.irfft(np.fft.rfft(samples[:, :1], axis=0) / omega[:, None], count, axis=0)
    mixed = np.hstack([velocity, samples[:, 1:]])
    orders = (1, 2, 2)
    found = bayesian_modes(mixed, case.rate_hz, np.array(case.frequency_hz), derivatives=orders)
    for one, other in zip(modes, found, strict=True):
        f, sd = one.frequency_hz.value, one.frequency_hz.sd
        assert other.frequency_hz.value == pytest.approx(f, abs=0.2 * sd)
        z = one.damping_ratio
        assert other.damping_ratio.value == pytest.approx(z.value, abs=0.3 * z.sd)
        turn = np.array([1 / (2j * np.pi * f), 1.0, 1.0])
        assert mac(other.shape, one.shape * turn) > 0.999


def test_a_colour_of_the_forces_moves_no_mode(short):
    # Velocities taken for accelerations are those under forces of that colour.
    case, samples, modes = short
    count = len(samples)
    omega = 2j * np.pi * np.fft.rfftfreq(count, 1 / case.rate_hz)
    omega[0] = 1.0
    spectrum = np.fft.rfft(samples, axis=0) / omega[:, None]
    other = np.fft.irfft(spectrum, count, axis=0)
    found = bayesian_modes(other, case.rate_hz, np.array(case.frequency_hz))
    for one, moved in zip(modes, found, strict=True):
        for what in ("frequency_hz", "damping_ratio"):
            told = getattr(one, what)
            assert getattr(moved, what).value == pytest.approx(told.value, abs=0.6 * told.sd)
            assert getattr(moved, what).sd == pytest.approx(told.sd, rel=0.25)


def test_one_channel_is_enough(short):
    case, samples, _ = short
    first = bayesian_modes(samples[:, 2], case.rate_hz, np.array(case.frequency_hz[:1]))[0]
    assert abs(first.frequency_hz.value - 1.0) < 4 * first.frequency_hz.sd
    np.testing.assert_allclose(first.shape, [1.0])


def test_where_there_is_no_mode_the_flags_say_so(short):
    case, samples, _ = short
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(samples.shape)
    (mode,) = bayesian_modes(noise, case.rate_hz, np.array([2.0]))
    assert mode.flags
    modes = bayesian_modes(samples, case.rate_hz, np.array(case.frequency_hz))
    assert not any(mode.flags for mode in modes)


def test_samples_are_left_as_they_were(short):
    case, samples, _ = short
    before = samples.copy()
    bayesian_modes(samples, case.rate_hz, np.array([1.0]))
    np.testing.assert_array_equal(samples, before)


def test_candidates_beyond_half_the_rate_are_refused(short):
    case, samples, _ = short
    with pytest.raises(ValueError, match=r"Allowed are .* leave out the others"):
        bayesian_modes(samples, case.rate_hz, np.array([1.0, 7.0]))


def test_derivatives_that_do_not_fit_the_channels_are_refused(short):
    case, samples, _ = short
    with pytest.raises(ValueError, match="for all or one a channel"):
        bayesian_modes(samples, case.rate_hz, np.array([1.0]), derivatives=(2, 1))


def test_a_copy_of_a_channel_is_refused_with_what_to_do(short):
    case, samples, _ = short
    twice = np.column_stack([samples[:, 0], samples[:, 0]])
    with pytest.raises(ValueError, match=r"a copy or a sum of others.*Leave out"):
        bayesian_modes(twice, case.rate_hz, np.array([1.0]))
