"""Learning of baselines: errors that channels have in common."""

import dataclasses
import json

import numpy as np
import pytest

from twin_server.estimate.elements.baseline_learning import common_errors
from twin_server.estimate.elements.memory import Baseline, ElementMemory, ModeSamples, Reference


def steps_of(errors):
    return np.diff(errors, axis=0) / np.sqrt(2.0)


@pytest.mark.parametrize("channels", [3, 8, 24])
@pytest.mark.parametrize("epochs", [4, 8, 20])
def test_independent_errors_have_no_patterns(channels, epochs):
    rng = np.random.default_rng(channels + epochs)
    found = [
        len(common_errors(steps_of(rng.standard_normal((epochs, channels)))))
        for _ in range(200)
    ]
    assert np.mean(np.array(found) > 0) < 0.06


@pytest.mark.parametrize(("channels", "rank"), [(24, 1), (24, 2), (24, 4), (8, 2)])
@pytest.mark.parametrize(("epochs", "most"), [(8, 3.7), (20, 2.2)])
def test_errors_along_few_shapes_are_covered_along_them(channels, rank, epochs, most):
    rng = np.random.default_rng(7)
    ratio, width = [], []
    for _ in range(100):
        shapes, _ = np.linalg.qr(rng.standard_normal((channels, rank)))
        size = np.sqrt(channels / rank)
        errors = size * rng.standard_normal((epochs + 1, rank)) @ shapes.T
        patterns = common_errors(steps_of(errors[:-1]))
        covariance = np.eye(channels) + patterns.T @ patterns
        # The next error is none of those that were learnt from.
        ratio.append(errors[-1] @ np.linalg.solve(covariance, errors[-1]) / rank)
        across = np.eye(channels) - shapes @ shapes.T
        width.append(np.trace(across @ covariance) / (channels - rank))
    # Independent errors would make it channels / rank; 1 would take far more epochs.
    assert np.mean(width) < 1.3
    assert 0.5 < np.mean(ratio) < min(most, 0.7 * channels / rank)


def test_one_step_or_one_channel_tells_nothing_of_common_errors():
    assert common_errors(np.ones((1, 5))).shape == (0, 5)
    assert common_errors(np.ones((5, 1))).shape == (0, 1)
    assert common_errors(np.zeros((5, 3))).shape == (0, 3)


def test_patterns_survive_a_restart_and_memories_without_them_are_read():
    baseline = Baseline(0, 3.0, 0.01, 0.02, 0.1, shape_common=((0.5, -1.0), (0.0, 2.0)))
    memory = ElementMemory(baselines=(baseline,), learnt_from=3)
    content = json.loads(json.dumps(dataclasses.asdict(memory)))
    assert ElementMemory.from_dict(content).baselines == (baseline,)
    del content["baselines"][0]["shape_common"]
    read = ElementMemory.from_dict(content).baselines
    assert read == (dataclasses.replace(baseline, shape_common=()),)


def test_steps_survive_a_restart_and_memories_without_them_are_read():
    lesson = ModeSamples(last=(0.6, 0.8), steps=((0.1, -2.0), (0.0, 1.0)))
    memory = ElementMemory(
        references=(Reference(3.0, (0.6, 0.8)),), lessons=(lesson,), learnt_from=3
    )
    content = json.loads(json.dumps(dataclasses.asdict(memory)))
    assert ElementMemory.from_dict(content).lessons == (lesson,)
    del content["lessons"][0]["steps"]
    assert ElementMemory.from_dict(content).lessons == (dataclasses.replace(lesson, steps=()),)
