"""A tower whose modes an edge agent identifies from samples: the group that lost is named."""

import dataclasses

import numpy as np
import pytest

from benchmarks.methods.monitored_tower import TowerTwin
from benchmarks.methods.sampled_tower import SampledTower


@pytest.mark.long
def test_the_group_that_lost_a_tenth_is_named_from_samples():
    tower = dataclasses.replace(TowerTwin.read(), sampled=True, window_s=300.0)
    found = tower.run(1, later=2)
    assert found.alone
    assert np.abs(found.misses).max() < 4.0
    assert found.ratio.max() < 0.2


@pytest.mark.long
def test_shapes_from_samples_err_as_stated():
    tower = dataclasses.replace(TowerTwin.read(), window_s=300.0)
    true = tower.at(np.zeros(len(tower.twin.free)))
    agent, rng = SampledTower(tower), np.random.default_rng(2)
    ratio = []
    for _ in range(4):
        for mode in agent.epoch(true, rng).modes:
            assert mode.shape is not None
            shape = np.array(mode.shape.re) + 1j * np.array(mode.shape.im)
            likeness = np.abs(shape.conj() @ true.shapes) / np.linalg.norm(true.shapes, axis=0)
            own = true.shapes[:, np.argmax(likeness)]
            own = own / np.linalg.norm(own)
            off = shape * np.exp(-1j * np.angle(np.vdot(own, shape))) - own
            off = off - own * np.vdot(own, off)
            ratio.append(np.mean(np.abs(off) ** 2 / np.array(mode.shape.sd) ** 2))
    assert len(ratio) >= 4 * 7
    assert 0.6 < np.mean(ratio) < 1.8
