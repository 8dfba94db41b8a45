"""Lines at one distance from many multiples of a speed belong to the machine."""

import numpy as np

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.harmonics.detection import find_harmonics
from slowtime.identification.harmonics.sidebands import group_into_sidebands
from slowtime.identification.single_mode.machine_lines import modes_and_machine_lines

RATE, SECONDS, SPEED, SLIP = 400.0, 20.0, 10.0, 1.37
MODE_HZ, DAMPING = 23.3, 0.01


def motor(rng):
    """A mode, harmonics of a speed, and faint sidebands whose level goes up and down."""
    count = round(SECONDS * RATE)
    seconds = np.arange(count) / RATE
    ringing = ambient_acceleration(Oscillator.from_modal(MODE_HZ, DAMPING), count, RATE, rng)
    samples = ringing / ringing.std() + 0.1 * rng.standard_normal(count)
    for order in range(1, 15):
        turn = 2 * np.pi * order * SPEED * seconds
        samples = samples + 3.0 * np.cos(turn + rng.uniform(0, 6))
        for side in (-1, 1):
            swell = 1 + 0.7 * np.cos(2 * np.pi * 0.11 * seconds + rng.uniform(0, 6))
            shift = 2 * np.pi * side * SLIP * seconds + rng.uniform(0, 6)
            samples = samples + 0.06 * swell * np.cos(turn + shift)
    return samples


def test_sidebands_are_lines_of_the_machine_and_a_mode_stays_one():
    samples = motor(np.random.default_rng(1))
    lines, families = find_harmonics(samples, RATE)
    found = np.array([line.frequency_hz.value for line in lines])
    expected = [n * SPEED + side * SLIP for n in range(1, 15) for side in (-1, 1)]
    missed = [f for f in expected if np.abs(found - f).min() > 1.0 / SECONDS]
    assert len(missed) <= 3
    assert np.abs(found - MODE_HZ).min() > 2 * DAMPING * MODE_HZ
    base = families[0]
    assert abs(base.base_hz.value - SPEED) < 1e-3
    np.testing.assert_allclose(
        found[list(base.members)], SPEED * np.array(base.orders), atol=0.01
    )
    told = modes_and_machine_lines(samples, RATE)
    assert [round(mode.frequency_hz.value) for mode in told.modes] == [round(MODE_HZ)]


def test_unrelated_peaks_are_no_sidebands():
    rng = np.random.default_rng(2)
    for _ in range(200):
        peaks = np.sort(rng.uniform(5.0, 200.0, 60))
        assert group_into_sidebands(peaks, base_hz=10.0, resolution_hz=0.05) == ()


def test_a_peak_below_half_of_the_speed_is_no_sideband():
    peaks = np.array([2.0, *(10.0 * n + 2.0 for n in range(1, 9))])
    (found,) = group_into_sidebands(peaks, base_hz=10.0, resolution_hz=0.01)
    assert found.members == tuple(range(1, 9))
