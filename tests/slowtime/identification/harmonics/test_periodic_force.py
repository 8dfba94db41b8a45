"""Lines of a periodic broadband force are the force, and lines of a machine a machine's."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.periodic_force import (
    mean_period,
    periodic_force_base,
)
from slowtime.identification.methods import by_method

RATE, PERIOD = 50.0, 2048
NATURAL_HZ, DAMPING = (2.0, 7.0), 0.02


def driven(force, rng):
    """Two modes under a force that repeats itself, and noise that does not."""
    samples = np.zeros((len(force), 3))
    for hz, shape in zip(NATURAL_HZ, ([1.0, 0.7, 0.4], [0.5, -0.6, 1.0]), strict=True):
        pole = np.exp((-DAMPING + 1j * np.sqrt(1 - DAMPING**2)) * 2 * np.pi * hz / RATE)
        sway = sps.lfilter([1.0, -1.0], [1.0, -2 * pole.real, abs(pole) ** 2], force)
        samples += np.outer(sway / sway.std(), shape)
    return samples + 0.05 * rng.standard_normal(samples.shape)


@pytest.fixture(scope="module")
def repeated():
    rng = np.random.default_rng(1)
    return driven(np.tile(rng.standard_normal(PERIOD), 11), rng)[PERIOD:]


@pytest.mark.parametrize("method", ["modes", "efdd", "bayes"])
def test_modes_under_a_repeated_force_are_known_as_well_as_from_one_period(repeated, method):
    found = by_method(repeated, RATE, method=method)
    assert {mode.kind for mode in found.modes} == {"structural"}
    near = [
        min(found.modes, key=lambda mode: abs(mode.frequency_hz.value - hz))
        for hz in NATURAL_HZ
    ]
    for mode, hz in zip(near, NATURAL_HZ, strict=True):
        assert "periodic_force" in mode.flags
        assert abs(mode.frequency_hz.value - hz) < 3 * mode.frequency_hz.sd
        # Least sd of a frequency over 41 s, and no better by the other nine periods.
        assert mode.frequency_hz.sd > 0.5 * hz * np.sqrt(DAMPING / (2 * np.pi * hz * 40.96))


def test_a_base_is_found_among_lines_that_are_not_all_its_multiples():
    rng = np.random.default_rng(2)
    base, resolution = 0.0244, 0.00244
    orders = rng.choice(np.arange(40, 1900), 60, replace=False)
    lines = [Measured(base * n + rng.normal(0, 2e-4), 1e-4) for n in orders]
    lines += [Measured(f, 1e-4) for f in (3.3337, 29.9)]
    assert periodic_force_base(tuple(lines), resolution) == pytest.approx(base, rel=1e-4)


def test_multiples_of_a_machine_and_unrelated_lines_are_no_such_force():
    machine = tuple(Measured(4.95 * n, 1e-3) for n in range(1, 30))
    assert periodic_force_base(machine, 0.01) is None
    rng = np.random.default_rng(3)
    for _ in range(50):
        lines = tuple(Measured(f, 1e-4) for f in rng.uniform(1, 45, 40))
        assert periodic_force_base(lines, 1 / 400) is None


def test_a_mean_over_periods_keeps_what_repeats_itself():
    once = np.random.default_rng(4).standard_normal((100, 2))
    longer = np.concatenate([np.tile(once, (5, 1)), once[:30]])
    np.testing.assert_allclose(mean_period(longer, 5.3), once)
    odd = np.zeros((1000, 1))
    assert mean_period(odd, 7.007) is odd


def test_a_channel_without_power_between_lines_raises_no_warning():
    rng = np.random.default_rng(5)
    command = np.tile(rng.standard_normal(500), 8)
    spectrum = np.fft.rfft(command)
    spectrum[len(spectrum) // 2 :] = 0.0
    samples = np.stack([np.fft.irfft(spectrum), rng.standard_normal(4000)], axis=1)
    by_method(samples, RATE, method="modes")


@pytest.mark.long
def test_a_tower_under_a_repeated_command_shows_its_modes_and_no_machine(data):
    samples = np.loadtxt(data / "unison_tower" / "wn_02.dat")
    found = by_method(samples, 100.0, method="modes")
    assert all(mode.kind == "structural" for mode in found.modes)
    assert all(mode.frequency_hz.sd > 1e-4 for mode in found.modes)
    for hz in (0.52, 1.76, 2.95, 4.2, 5.42):
        near = min(found.modes, key=lambda mode: abs(mode.frequency_hz.value - hz))
        assert near.frequency_hz.value == pytest.approx(hz, rel=0.05)
