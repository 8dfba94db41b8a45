"""Sensors that are placed on the tower, against sensors spread uniformly over it."""

import numpy as np
import pytest

from benchmarks.methods.sensor_placement import BETTER, SensorCandidates

SEEDS = 6
"""`python -m benchmarks.methods.sensor_placement` runs two hundred."""


@pytest.fixture(scope="module")
def tower():
    return SensorCandidates.read(4)


def test_placed_sensors_are_expected_to_tell_a_fifth_more(tower):
    placed, spread = tower.placed(8), tower.spread(8)
    assert len(set(placed.sites)) == len(set(spread.sites)) == 8
    assert placed.posterior_sd.mean() < BETTER * spread.posterior_sd.mean()


@pytest.mark.long
def test_updates_err_by_as_much_as_the_placement_expects(tower):
    placed = tower.placed(8)
    found = np.array([tower.errors(seed, placed.sites)[0] for seed in range(SEEDS)])
    chi2 = float(np.mean((found[..., 0] / placed.posterior_sd) ** 2))
    # 36 values of chi-square with mean 1 have a mean of 0.4 to 1.9 with 99.9 %.
    assert 0.4 < chi2 < 1.9
