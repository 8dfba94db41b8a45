"""Supports that stand still while the base moves, against SciPy's integration of a wall."""

import dataclasses

import numpy as np
import pytest

from slowtime.dynamics.channels import DescriptionError
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Support
from slowtime.dynamics.plant import Plant
from tests.third_party_rigs.rigs import FINE, STILL, Excitation, Link, Structure, run

RATE_HZ, SAMPLES = 200.0, 800
LINKS = (Link("s1", (-1, 0), 6000.0, 4.0), Link("s2", (0, 1), 4000.0, 3.0))
FINE_S = np.arange((SAMPLES - 1) * FINE + 1) / (RATE_HZ * FINE)
SHAKEN = np.sum([np.sin(2 * np.pi * hz * FINE_S + hz**2) for hz in range(2, 15)], axis=0)
BASE_INPUT = Input(channel="u", kind="base_acceleration", unit="m/s^2", hold="band_limited")


def measured(law):
    """Accelerations of two masses on a shaken base, the first beside a wall."""
    given = Excitation(RATE_HZ, SAMPLES, np.zeros((len(FINE_S), 2)), SHAKEN, np.zeros((2, 2)))
    return run(Structure((3.0, 2.0), LINKS, forces=(((STILL, 0), law),)), given)["a"]


def described(*effects, stiffness=0.0, damping=0.0, inputs=(BASE_INPUT,)):
    ends = {-1: "base", 0: "f1", 1: "f2"}
    springs = [
        (one.name, (ends[one.between[0]], ends[one.between[1]]), one.stiffness, one.damping)
        for one in LINKS
    ]
    springs.append(("beside", ("wall", "f1"), stiffness, damping))
    return Description(
        name="rig",
        nodes=(Node(id="f1", mass_kg=3.0), Node(id="f2", mass_kg=2.0)),
        supports=(Support(id="wall", still=True),),
        elements=tuple(
            Spring(id=name, between=ends, stiffness_n_per_m=k, damping_n_s_per_m=c)
            for name, ends, k, c in springs
        ),
        inputs=inputs,
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"f{i}", unit="m/s^2")
            for i in (1, 2)
        ),
        effects=effects,
    )


DRAG = {"effect": "quadratic_damping", "element": "beside", "c2_n_s2_per_m2": 40.0}


@pytest.mark.parametrize(
    ("law", "description"),
    [
        (lambda x, w, t: 900.0 * x, described(stiffness=900.0)),
        (lambda x, w, t: 30.0 * w, described(damping=30.0)),
        (lambda x, w, t: 40.0 * abs(w) * w, described(DRAG)),
    ],
    ids=["spring", "damper", "drag"],
)
def test_a_wall_holds_the_structure_while_the_base_moves(law, description):
    plant = Plant.of(description)
    truth, without = measured(law), measured(lambda x, w, t: 0.0)
    found = plant.simulate(plant.values, SHAKEN[::FINE, None], RATE_HZ)
    assert np.all((found - truth).std(axis=0) < 1e-3 * (truth - without).std(axis=0))


def test_a_support_stands_still_or_is_moved_by_an_input():
    moved = dataclasses.replace(BASE_INPUT, kind="imposed_acceleration", node="wall")
    with pytest.raises(DescriptionError, match="'wall' stands still, but input 'u' moves it"):
        described(inputs=(moved,))
