"""Exponents are held at the value of a law's simplest form, where that explains as much."""

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.model_evidence import evidence, sds_from_natural_value
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.natural_values import hold_natural_values
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant

KINDS = catalogue()
RATE = 100.0
FORCES = {"m": "N", "rad": "N m"}


def mass(*effects, unit="m"):
    return Description(
        name="mass",
        nodes=(Node(id="m", mass_kg=1.0),),
        elements=(
            Spring(
                id="k", between=("base", "m"), stiffness_n_per_m=40.0, damping_n_s_per_m=0.4
            ),
        ),
        inputs=(Input(channel="f", kind="force", node="m", unit=FORCES[unit]),),
        sensors=(
            Sensor(
                channel="x", quantity="displacement", node="m", unit=unit,
                frame="relative_to_base",
            ),
        ),
        effects=effects,
        unit_of_coordinate=unit,
        tolerance=Tolerance(stiffness=0.02, damping=0.5, mass=0.0),
    )  # fmt: skip


def fitted(effect, unit="m", start=None):
    """Simulate an effect, and fit it to the record with noise of 50 dB."""
    rng = np.random.default_rng(3)
    force = np.convolve(rng.standard_normal(2000), np.ones(8) / 8, mode="same")[:, None] * 30.0
    plant = Plant.of(mass(effect, unit=unit), kinds=KINDS)
    outputs = plant.simulate(plant.values, force, RATE)
    noise = 3e-3 * outputs.std() * rng.standard_normal(outputs.shape)
    trial = Trial(inputs=force, outputs=outputs + noise, rate_hz=RATE)
    model = Plant.of(mass({**effect, **(start or {})}, unit=unit), kinds=KINDS)
    given = refit(Plant.of(mass(unit=unit), kinds=KINDS), (trial,))
    return Hypothesis((given, refit(model, (trial,))), (trial,))


@pytest.mark.parametrize(("true", "held"), [(1.0, True), (2.0, False)])
def test_an_exponent_is_held_at_one_where_it_is_one(true, held):
    effect = {
        "effect": "bouc_wen_general", "element": "k", "kh_n_per_m": 20.0, "beta_per_mn": 0.8,
        "gamma_per_mn": -0.5, "n": true,
    }  # fmt: skip
    free = fitted(effect, start={"n": 1.3})
    name = ("effect", 0, "n")
    again = hold_natural_values(free, KINDS)
    assert (again is not free) == held
    assert (name in again.last.prior.names) != held
    if held:
        at = list(again.last.plant.entries).index(name)
        assert again.last.values[at] == 1.0
        assert again.last.sd.max() <= free.last.sd.max() * 1.001
        assert again.last.cost < free.last.cost + 4


@pytest.mark.parametrize(("true", "simple"), [(40.0, True), (20.0, False)])
def test_a_pendulum_whose_torque_is_all_of_its_stiffness_costs_no_parameter(true, simple):
    last = fitted({"effect": "pendulum_sine", "element": "k", "k": true}, unit="rad").last
    name = ("effect", 0, "k")
    assert (sds_from_natural_value(last, name) < 3) == simple
    charged = -evidence(last, KINDS) - last.cost / 2
    assert (charged < 0.9 * np.log(last.data) / 2) == simple
    assert charged >= 0
    # Nothing is simpler about a stiffness or a damping.
    assert sds_from_natural_value(last, ("stiffness", "k")) == np.inf
