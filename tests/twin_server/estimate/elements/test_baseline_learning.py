"""Learning of baselines: errors that channels have in common."""

import dataclasses
import json

import numpy as np
import pytest

from twin_server.estimate.elements.baseline_learning import common_error_factor
from twin_server.estimate.elements.memory import Memory, ModeSamples, Reference


def steps_of(errors):
    return np.diff(errors, axis=0) / np.sqrt(2.0)


@pytest.mark.parametrize("channels", [3, 8, 24])
@pytest.mark.parametrize("epochs", [4, 8, 20])
def test_independent_errors_are_left_as_they_are(channels, epochs):
    rng = np.random.default_rng(channels + epochs)
    found = [
        common_error_factor(steps_of(rng.standard_normal((epochs, channels))))
        for _ in range(200)
    ]
    assert np.mean(np.array(found) > 1.0) < 0.06


@pytest.mark.parametrize(("channels", "rank"), [(24, 1), (24, 2), (8, 2)])
def test_errors_that_lie_along_few_shapes_are_covered_along_them(channels, rank):
    rng = np.random.default_rng(7)
    found = []
    for _ in range(100):
        shapes, _ = np.linalg.qr(rng.standard_normal((channels, rank)))
        size = np.sqrt(channels / rank)
        errors = size * rng.standard_normal((20, rank)) @ shapes.T
        found.append(common_error_factor(steps_of(errors)))
    assert np.median(found) == pytest.approx(np.sqrt(channels / rank), rel=0.1)


def test_one_step_or_one_channel_tells_nothing_of_common_errors():
    assert common_error_factor(np.ones((1, 5))) == 1.0
    assert common_error_factor(np.ones((5, 1))) == 1.0
    assert common_error_factor(np.zeros((5, 3))) == 1.0


def test_steps_survive_a_restart_and_memories_without_them_are_read():
    lesson = ModeSamples(last=(0.6, 0.8), steps=((0.1, -2.0), (0.0, 1.0)))
    memory = Memory(references=(Reference(3.0, (0.6, 0.8)),), lessons=(lesson,), learnt_from=3)
    content = json.loads(json.dumps(dataclasses.asdict(memory)))
    assert Memory.from_dict(content).lessons == (lesson,)
    del content["lessons"][0]["steps"]
    assert Memory.from_dict(content).lessons == (dataclasses.replace(lesson, steps=()),)
