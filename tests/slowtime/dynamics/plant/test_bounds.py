"""No node may weigh less than nothing."""

import dataclasses
import math

import pytest

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.effects.effect import Place
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.plant.parameter_names import lowest

TWO = chain([2.0, 3.0], [800.0, 600.0], dampings_n_s_per_m=[1.0, 1.0])
KINDS = catalogue()


def test_a_mass_may_be_taken_away_but_for_a_twentieth_of_what_the_node_has():
    effect = {"effect": "added_mass", "node": "m2", "dm_kg": 0.1}
    plant = Plant.of(dataclasses.replace(TWO, effects=(effect,)))
    assert plant.entries["effect", 0, "dm_kg"].low == pytest.approx(-0.95 * 3.0)


def test_what_weighs_nothing_has_no_such_bound():
    place = Place("element", TWO.elements[0].id)
    assert lowest(TWO, place, KINDS["stiffness_loss"]) == -math.inf
    assert lowest(TWO, Place("node", "m1"), KINDS["extra_dof"]) == -math.inf


def test_a_factor_keeps_its_sign_and_leaves_something():
    inputs = (Input(channel="u", kind="force", node="m1", unit="N"),)
    for gain, (low, high) in ((2.0, (0.02, 200.0)), (-1.0, (-100.0, -0.01))):
        effect = {"effect": "input_gain", "input": "u", "gain": gain}
        plant = Plant.of(dataclasses.replace(TWO, inputs=inputs, effects=(effect,)))
        entry = plant.entries["effect", 0, "gain"]
        assert (entry.low, entry.high) == (low, high)
