"""A force that turns by a clock of its own is heard at that clock's frequency."""

import numpy as np
import pytest

from slowtime.discrepancy.candidates.modulation import modulation_frequencies_hz

STARTS, LENGTHS, RATE = (0.0, 79.3, 344.0), (22.4, 59.1, 46.1), 100.0
TRUE_HZ = 5.6129


def recorded(rng):
    """Give times, and a motion that swings about 4.6 Hz, louder from record to record."""
    times = [s + np.arange(int(n * RATE)) / RATE for s, n in zip(STARTS, LENGTHS, strict=True)]
    moved = [
        level * np.convolve(rng.standard_normal(len(t) + 99), ring(), "valid")
        for level, t in zip((1.0, 1.4, 3.0), times, strict=True)
    ]
    return times, moved


def ring():
    lag = np.arange(100) / RATE
    return np.exp(-3.0 * lag) * np.sin(2 * np.pi * 4.6 * lag)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clock_that_is_none_of_the_motions_is_found_to_a_part_of_one_over_the_campaign(seed):
    rng = np.random.default_rng(seed)
    times, moved = recorded(rng)
    forces = [
        e * np.cos(2 * np.pi * TRUE_HZ * t - 1.4) + 0.3 * e.std() * rng.standard_normal(len(t))
        for e, t in zip(moved, times, strict=True)
    ]
    best = modulation_frequencies_hz(forces, moved, times)[0]
    span = STARTS[-1] + LENGTHS[-1]
    assert abs(best - TRUE_HZ) < 0.05 / span


def test_where_nothing_moves_there_is_no_clock():
    times = [np.arange(200) / RATE]
    assert modulation_frequencies_hz([np.ones(200)], [np.zeros(200)], times) == []


def test_a_line_that_is_heard_is_looked_at_though_others_are_louder_in_the_force():
    rng = np.random.default_rng(4)
    times, _ = recorded(rng)
    ones = [np.ones(len(t)) for t in times]
    louder = (0.21, 0.37, 0.52, 0.71, 0.93)  # of each record for itself, by no clock of all
    forces = [
        np.cos(2 * np.pi * TRUE_HZ * t - 0.4)
        + sum(4 * np.cos(2 * np.pi * f * t + turn) for f, turn in
              zip(louder, rng.uniform(0, 2 * np.pi, 5), strict=True))
        for t in times
    ]  # fmt: skip
    span = STARTS[-1] + LENGTHS[-1]

    def nearest(heard):
        return min(
            abs(one - TRUE_HZ) for one in modulation_frequencies_hz(forces, ones, times, heard)
        )

    assert nearest(()) > 1.0
    assert nearest((TRUE_HZ + 0.01,)) < 0.1 / span
