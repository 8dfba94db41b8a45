"""Sensors at other nodes than the model says."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.wiring import find_rewiring
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant

GIVEN = dataclasses.replace(
    chain([3.0, 2.5, 2.0], [9000.0, 7000.0, 5000.0], dampings_n_s_per_m=[9.0, 7.0, 5.0]),
    inputs=(Input(channel="u", kind="force", node="m3", unit="N"),),
    sensors=tuple(
        Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
        for i in (1, 2, 3)
    ),
    tolerance=Tolerance(stiffness=0.03, damping=0.2),
)


def records(nodes, count, **more):
    """Records of sensors that sit at some nodes; stiffness is 1 % off."""
    sensors = tuple(
        dataclasses.replace(one, node=node)
        for one, node in zip(GIVEN.sensors, nodes, strict=True)
    )
    off = chain([3.0, 2.5, 2.0], [9090.0, 7070.0, 5050.0], dampings_n_s_per_m=[9.0, 7.0, 5.0])
    real = dataclasses.replace(GIVEN, sensors=sensors, elements=off.elements, **more)
    plant, rng = Plant.of(real), np.random.default_rng(7)
    for _ in range(count):
        u = 20.0 * rng.normal(size=(2000, 1))
        y = plant.simulate(plant.values, u, 100.0)
        noise = 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
        yield Trial(inputs=u, outputs=y + noise, rate_hz=100.0)


@pytest.mark.parametrize(
    ("nodes", "moves"),
    [
        (("m2", "m1", "m3"), {0: "m2", 1: "m1"}),
        (("m1", "m2", "m1"), {2: "m1"}),
        (("m1", "m2", "m3"), None),
    ],
)
def test_sensors_that_sit_elsewhere_are_found_and_no_others(nodes, moves):
    found = find_rewiring(GIVEN, tuple(records(nodes, 1)), catalogue())
    assert (found and dict(found.moves)) == moves


def test_sensors_of_forces_are_left_where_they_are():
    force = Sensor(channel="f", quantity="force", element=GIVEN.elements[1].id, unit="N")
    given = dataclasses.replace(GIVEN, sensors=(force, *GIVEN.sensors))
    sat = (
        dataclasses.replace(given.sensors[1], node="m2"),
        dataclasses.replace(given.sensors[2], node="m1"),
    )
    plant = Plant.of(dataclasses.replace(given, sensors=(force, *sat, given.sensors[3])))
    u = np.random.default_rng(8).normal(size=(2000, 1))
    y = plant.simulate(plant.values, u, 100.0)
    y += 0.01 * y.std(axis=0) * np.random.default_rng(9).normal(size=y.shape)
    found = find_rewiring(given, (Trial(inputs=u, outputs=y, rate_hz=100.0),), catalogue())
    assert found is not None
    assert dict(found.moves) == {1: "m2", 2: "m1"}


def test_a_law_that_is_missing_is_not_taken_for_a_sensor_elsewhere():
    effect = {"effect": "cubic_hardening", "element": GIVEN.elements[0].id, "k3_n_per_m3": 3e8}
    trials = tuple(records(("m1", "m2", "m3"), 1, effects=(effect,)))
    assert find_rewiring(GIVEN, trials, catalogue()) is None


@pytest.mark.long
def test_two_channels_that_are_exchanged_are_named_and_put_right():
    first, second, held = records(("m2", "m1", "m3"), 3)
    answer = diagnose(Campaign(description=GIVEN, trials=(first, second), holdout=(held,)))
    assert answer.verdict == "sensor_fault"
    named = {(one.effect.kind, one.effect.place.id) for one in answer.effects}
    assert named == {("sensor_misplaced", "a1"), ("sensor_misplaced", "a2")}
    assert "Sensor a1 reads the motion of node m2" in answer.sentence
    assert [one.node for one in answer.augmented.sensors] == ["m2", "m1", "m3"]
    assert answer.nominal == GIVEN
    gap = answer.gap
    assert gap.augmented < 1.15 * gap.noise_floor < 0.1 * gap.refitted_nominal
