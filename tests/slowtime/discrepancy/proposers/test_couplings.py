"""Gyroscopic couplings of two directions, against SciPy's solution of their equations."""

import dataclasses

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.localization.linear_response import LinearModel
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import (
    Description,
    DescriptionError,
    Input,
    Node,
    Sensor,
    Spring,
    Tolerance,
)
from slowtime.dynamics.effects import read_effects
from slowtime.dynamics.plant import Plant

RATE, G = 200.0, 6.0
MASS = {"x1": 3.0, "x2": 2.0, "y1": 3.0, "y2": 2.0}
LINKS = {
    "kx1": ("base", "x1", 6000.0, 4.0), "kx2": ("x1", "x2", 4000.0, 3.0),
    "ky1": ("base", "y1", 7000.0, 4.0), "ky2": ("y1", "y2", 4500.0, 3.0),
}  # fmt: skip


def shaft(**more):
    """Two discs of a shaft in two directions, which nothing couples."""
    given = Description(
        name="shaft",
        nodes=tuple(Node(id=name, mass_kg=mass) for name, mass in MASS.items()),
        elements=tuple(
            Spring(id=name, between=(a, b), stiffness_n_per_m=k, damping_n_s_per_m=c)
            for name, (a, b, k, c) in LINKS.items()
        ),
        inputs=(Input(channel="u", kind="force", node="x2", unit="N", hold="first"),),
        sensors=tuple(
            Sensor(channel=f"a{name}", quantity="acceleration", node=name, unit="m/s^2")
            for name in MASS
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.2),
    )
    return dataclasses.replace(given, **more)


def matrices():
    """Mass, damping and stiffness with a gyroscopic moment between x2 and y2."""
    names = list(MASS)
    mass = np.diag(list(MASS.values()))
    stiffness, damping = np.zeros((4, 4)), np.zeros((4, 4))
    for a, b, k, c in LINKS.values():
        row = np.array([float(n == b) - float(n == a) for n in names])
        stiffness += k * np.outer(row, row)
        damping += c * np.outer(row, row)
    first, second = names.index("x2"), names.index("y2")
    damping[first, second] += G
    damping[second, first] -= G
    return mass, damping, stiffness


def turning(u):
    """Accelerations of the coupled discs, solved by SciPy."""
    mass, damping, stiffness = matrices()
    inverse = np.linalg.inv(mass)
    flow = np.block([[np.zeros((4, 4)), np.eye(4)], [-inverse @ stiffness, -inverse @ damping]])
    push = inverse[:, [list(MASS).index("x2")]]
    system = (flow, np.vstack([np.zeros((4, 1)), push]), flow[4:], push)
    return sps.lsim(system, u, np.arange(len(u)) / RATE)[1]


def joined(ends=("x2", "y2")):
    """The shaft with a coupling between two points."""
    link = Spring(id="link", between=ends)
    effect = {"effect": "gyroscopic_coupling", "element": "link", "g_n_s_per_m": G}
    given = shaft()
    return dataclasses.replace(given, elements=(*given.elements, link), effects=(effect,))


def test_a_coupling_turns_one_direction_into_the_other():
    u = np.random.default_rng(1).normal(size=(600, 1))
    plant = Plant.of(joined())
    found, truth = plant.simulate(plant.values, u, RATE), turning(u)
    np.testing.assert_allclose(found, truth, atol=1e-6 * np.abs(truth).max())


def test_beside_a_coupling_the_linear_response_is_that_of_its_equations():
    plant = Plant.of(joined())
    model = LinearModel.of_plant(plant, plant.values)
    mass, damping, stiffness = matrices()
    for hz in (0.5, 6.0, 11.0):
        s = 2j * np.pi * hz
        exact = np.linalg.inv(s**2 * mass + s * damping + stiffness)
        found = model.compliance(np.array([hz]))[0]
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


def test_a_coupling_to_the_ground_is_refused():
    with pytest.raises(DescriptionError, match="between two nodes that are free to move"):
        read_effects(joined(("base", "y2")))


@pytest.mark.long
def test_a_coupling_that_the_model_has_no_place_for_is_named():
    rng = np.random.default_rng(2)

    def record():
        u = 20.0 * rng.normal(size=(3000, 1))
        y = turning(u)
        return Trial(
            inputs=u, outputs=y + 0.01 * y.std(axis=0) * rng.normal(size=y.shape), rate_hz=RATE
        )

    answer = diagnose(
        Campaign(description=shaft(), trials=(record(), record()), holdout=(record(),))
    )
    (found,) = answer.effects
    assert (found.effect.kind, found.effect.place.id) == ("gyroscopic_coupling", "x2-y2")
    told = found.numbers["g_n_s_per_m"]
    assert abs(told.value - G) < 3 * told.sd < 0.05 * G
    assert answer.gap.augmented < 1.15 * answer.gap.noise_floor
