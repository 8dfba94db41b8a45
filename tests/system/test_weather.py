"""The demo's bridge in the weather, from samples to alarm, in a year of sixty days."""

import numpy as np
import pytest

from edge_agent.extract import Extract
from edge_agent.settings import ExtractSettings, Origin
from slowtime_cli.shared.demo_structures import METHODS, registration, structure
from slowtime_schemas.messages import Features
from slowtime_services.simulate import simulated_structure
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.registration.twin import Registration

YEAR, CRACKS, DAYS = 60.0, 84.0, 110


@pytest.fixture(scope="module")
def told():
    """What the edge tells of it, day by day."""
    fields = structure("bridge")
    fields["temperature"] = {**fields["temperature"], "period": YEAR}
    fields["stiffness"] = {**fields["stiffness"], "at_slow_time": CRACKS}
    bridge = simulated_structure(fields)
    settings = ExtractSettings(method=METHODS["bridge"])
    origin = Origin(site="demo", asset="bridge", boot="b1", slow_time_unit="d")
    extract = Extract(settings, origin)
    state, messages = extract.start(), list[Features]()
    for day in range(DAYS):
        (block,) = bridge.epoch(day)
        marks = np.zeros((len(block.samples), 2), dtype=int)
        state, features = extract.step(state, block, marks)
        messages += features
    return [*messages, *extract.finish(state)[1]]


def follow(messages, body):
    made = Registration(**body)
    start = Twin(made, Checkpoint.start(made))
    found = estimate([start], messages, [0] * len(messages), [0] * len(messages))
    return found.states, found.notices[0], found.checkpoints[0]


@pytest.mark.long
def test_the_crack_is_found_and_sized_and_the_weather_is_not_taken_for_one(told):
    body = registration("bridge")
    body["covariates"] |= {"train_span": YEAR - 1.0, "train_epochs": 50}
    states, notices, checkpoint = follow(told, body)
    assert len(states) == DAYS
    learnt = [n for n in notices if n.kind == "normal_learnt"]
    assert [(n.row, n.details["law"]) for n in learnt] == [(59, "bilinear")]
    entered = [n for n in notices if n.kind == "change_entered"]
    assert len(entered) == 1
    assert CRACKS <= entered[0].row < CRACKS + 14
    size = entered[0].details["stiffness_change"]
    assert size["lo"] < -0.03 < size["hi"] < 0.0
    entry = checkpoint.condition.entered(Registration(**body).covariates)
    assert entry.stiffness_interval[0] < -0.03 < entry.stiffness_interval[1]
    judged = states[states["reasons"] == 0]
    held = (judged["stiffness_change"][:, 2] <= judged["truth"][:, 2]) & (
        judged["truth"][:, 2] <= judged["stiffness_change"][:, 3]
    )
    assert held.mean() > 0.85
    assert set(judged["truth"][:, 2].tolist()) == {0.0, -0.03}


@pytest.mark.long
def test_without_covariates_the_weather_is_all_that_is_seen(told):
    states, notices, _ = follow(told, {"changes": "stiffness", "learn_epochs": 20})
    change = states["stiffness_change"][20:, 0]
    assert np.ptp(change) > 4 * 0.03
    assert not any(n.kind == "change_entered" for n in notices)
