"""Laws at joints of moved supports are named, with reactions among what is measured."""

import dataclasses

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import (
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Support,
    Tolerance,
)
from slowtime.dynamics.effects import Place
from slowtime.dynamics.plant import Plant

RATE = 100.0
RIG = Description(
    name="pair",
    nodes=(Node(id="m1", mass_kg=2.0), Node(id="m2", mass_kg=1.5)),
    supports=(Support(id="table"),),
    elements=(
        Spring(id="k1", between=("table", "m1"), stiffness_n_per_m=900.0,
               damping_n_s_per_m=2.0),
        Spring(id="k2", between=("m1", "m2"), stiffness_n_per_m=700.0, damping_n_s_per_m=1.0),
        Spring(id="k3", between=("m2", "base"), stiffness_n_per_m=800.0,
               damping_n_s_per_m=3.0),
    ),
    inputs=(Input(channel="x", kind="imposed_displacement", node="table", unit="m"),),
    sensors=(
        Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),
        Sensor(channel="a2", quantity="acceleration", node="m2", unit="m/s^2"),
        Sensor(channel="f", quantity="force", node="table", unit="N"),
    ),
    tolerance=Tolerance(stiffness=0.03, damping=0.2),
)  # fmt: skip


def records(effect, seed):
    rng = np.random.default_rng(seed)
    band = sps.butter(4, 8.0, fs=RATE, output="sos")
    plant, found = Plant.of(dataclasses.replace(RIG, effects=(effect,))), []
    for level in (0.02, 0.03, 0.03):
        moved = level * sps.sosfiltfilt(band, rng.standard_normal(2500))[:, None]
        told = plant.simulate(plant.values, moved, RATE)
        told += 0.02 * told.std(axis=0) * rng.standard_normal(told.shape)
        found.append(Trial(inputs=moved, outputs=told, rate_hz=RATE))
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "name", "size"),
    [
        ({"effect": "coulomb", "element": "k1", "friction_n": 1.5}, "friction_n", 1.5),
        (
            {"effect": "cubic_hardening", "element": "k1", "k3_n_per_m3": 4e5},
            "k3_n_per_m3",
            4e5,
        ),
    ],
    ids=["friction", "cubic"],
)  # fmt: skip
def test_a_law_at_the_joint_of_a_moved_support_is_named(effect, name, size):
    *learnt, judged = records(effect, 3)
    found = diagnose(Campaign(description=RIG, trials=tuple(learnt), holdout=(judged,)))
    (answer,) = found.effects
    assert answer.effect.kind == effect["effect"]
    assert answer.effect.place == Place("element", "k1")
    assert answer.numbers[name].value == pytest.approx(size, rel=0.02)
    assert found.gap.augmented < 0.025
