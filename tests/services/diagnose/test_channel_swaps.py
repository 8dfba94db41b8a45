"""Two channels whose wires were exchanged, on a chain of three masses."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant
from slowtime_services.diagnose.channel_swaps import likely_pair
from slowtime_services.diagnose.record_checks import refuse_nonsense
from slowtime_services.files import RecordError

RATE, NODES = 100.0, ("m1", "m2", "m3")


def chain(*effects, off=1.0):
    ends = zip(("base", *NODES), NODES, strict=False)
    return Description(
        name="chain",
        nodes=tuple(Node(id=name, mass_kg=1.5) for name in NODES),
        elements=tuple(
            Spring(
                id=f"j{i}",
                between=pair,
                stiffness_n_per_m=off * (2000.0 + 300 * i),
                damping_n_s_per_m=2.0,
            )
            for i, pair in enumerate(ends)
        ),
        inputs=(Input(channel="u", kind="force", node="m3", unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i + 1}", quantity="acceleration", node=name, unit="m/s^2")
            for i, name in enumerate(NODES)
        ),
        effects=effects,
        tolerance=Tolerance(stiffness=0.02, damping=0.15),
    )


def campaign(swap=(0, 1, 2), *effects, off=1.0, seed=1):
    rng = np.random.default_rng(seed)
    push = 10.0 * rng.standard_normal((800, 1))
    plant = Plant.of(chain(*effects, off=off), kinds=catalogue())
    outputs = plant.simulate(plant.values, push, RATE)
    outputs = outputs + 0.03 * outputs.std() * rng.standard_normal(outputs.shape)
    trial = Trial(inputs=push, outputs=outputs[:, list(swap)], rate_hz=RATE)
    return Campaign(description=chain(), trials=(trial,))


SWAPS = [((2, 1, 0), "a1", "a3"), ((1, 0, 2), "a1", "a2"), ((0, 2, 1), "a2", "a3")]


@pytest.mark.parametrize(("swap", "one", "two"), SWAPS)
def test_powers_are_nearest_to_the_models_where_wires_are_put_right(swap, one, two):
    (trial,) = campaign(swap, off=1.03).trials
    plant = Plant.of(chain(), kinds=catalogue())
    made = plant.simulate(plant.values, trial.inputs, RATE)
    assert likely_pair(plant.description, trial, made) == (int(one[1]) - 1, int(two[1]) - 1)


@pytest.mark.slow
@pytest.mark.parametrize(("swap", "one", "two"), SWAPS)
def test_exchanged_sensors_are_told_with_the_roles_that_mend_them(swap, one, two):
    with pytest.raises(
        RecordError, match=f"{one} and {two} appear to be exchanged.*--setting unchecked=yes"
    ) as told:
        refuse_nonsense(campaign(swap, off=1.03), ["r.csv"])
    assert f"--channel {one}={two} --channel {two}={one}" in str(told.value)


CUBIC = {"effect": "cubic_hardening", "element": "j1", "k3_n_per_m3": 3e7}
LOSS = {"effect": "stiffness_loss", "element": "j2", "dk_n_per_m": 1200.0}
RUBS = {"effect": "coulomb", "element": "j0", "friction_n": 5.0}


@pytest.mark.parametrize(
    "effects", [(), (CUBIC,), (LOSS,), pytest.param((RUBS,), marks=pytest.mark.slow)]
)
def test_what_is_missing_is_not_taken_for_a_wire(effects):
    refuse_nonsense(campaign((0, 1, 2), *effects, off=0.95, seed=2), ["r.csv"])


@pytest.mark.long
@pytest.mark.parametrize("effects", [(), (CUBIC,)])
@pytest.mark.parametrize("crossed", [True, False])
def test_exchanged_inputs_are_told_and_right_ones_are_not(effects, crossed):
    rng = np.random.default_rng(4)
    two = (*chain().inputs, Input(channel="w", kind="force", node="m1", unit="N"))
    model = dataclasses.replace(chain(), inputs=two)
    push = rng.standard_normal((800, 2)) * [10.0, 4.0]
    plant = Plant.of(
        dataclasses.replace(chain(*effects, off=1.03), inputs=two), kinds=catalogue()
    )
    outputs = plant.simulate(plant.values, push, RATE)
    outputs = outputs + 0.03 * outputs.std() * rng.standard_normal(outputs.shape)
    said = push[:, ::-1].copy() if crossed else push
    given = Campaign(
        description=model, trials=(Trial(inputs=said, outputs=outputs, rate_hz=RATE),)
    )
    if not crossed:
        refuse_nonsense(given, ["r.csv"])
        return
    with pytest.raises(RecordError, match=r"u and w appear to be exchanged.*--channel u=w"):
        refuse_nonsense(given, ["r.csv"])
