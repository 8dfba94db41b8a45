"""A tower under 24 channels: the twin names the group that lost stiffness."""

import numpy as np
import pytest

from benchmarks.methods.monitored_tower import LOSS, TowerTwin

SEEDS = 6
"""One loss of each group; `python -m benchmarks.methods.monitored_tower` runs fifty."""


@pytest.mark.long
def test_the_group_that_lost_a_tenth_is_named_and_its_size_is_covered():
    tower = TowerTwin.read()
    assert len(tower.full.channels) == 24
    found = [tower.run(seed) for seed in range(SEEDS)]
    assert {one.group for one in found} == set(tower.twin.free)
    assert all(one.among for one in found)
    assert sum(one.alone for one in found) >= SEEDS - 1
    misses = np.array([one.misses for one in found])
    # 36 values of chi-square with mean 1 have a mean within 0.4 to 1.9 with 99.9 %.
    assert 0.4 < np.mean(misses**2) < 1.9
    assert max(float(one.ratio.max()) for one in found) < -2.5 * LOSS
