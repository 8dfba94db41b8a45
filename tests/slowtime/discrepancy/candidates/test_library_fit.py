"""Laws of the library are ranked by what they explain along the recovered force."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import (
    is_applicable,
    library_candidates,
    mirrored_factor,
)
from slowtime.discrepancy.localization import locate
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import candidate
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import EVERY, recorded

KINDS = catalogue()


def test_laws_are_ranked_though_no_force_anywhere_is_worth_what_it_costs():
    few = {name: KINDS[name] for name in ("cubic_hardening", "quadratic_damping")}
    hard = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
    trials = recorded(ONE, (hard,), level=2.0)
    before = refit_within_tolerances(refit(Plant.of(ONE, kinds=few), trials), trials)
    located = locate(before, trials)
    groups = tuple(
        dataclasses.replace(group, score=-1e5, left=20.0) for group in located.groups
    )
    found = library_candidates(before, dataclasses.replace(located, groups=groups), few)
    assert {one.effect.place for one in found} >= {PLACE}


def test_one_sensors_factor_mirrors_that_of_the_input_also_where_it_fared_badly():
    known = Effect("input_gain", Place("input", "u"), {"gain": 1.4})
    own = Effect("sensor_gain", Place("sensor", "x"), {"gain": 1.1})
    labels = [candidate(known, 10.0, cost_without=1e4), candidate(own, 4e3, cost_without=1e4)]
    (mirror,) = mirrored_factor(labels, labels, KINDS)
    assert (mirror.effect.kind, mirror.effect.parameters) == ("sensor_gain", {"gain": 1.4})
    assert mirror.cost == 10.0


@pytest.mark.long
@pytest.mark.parametrize("times", [0.7, 1.3, 2.2])
def test_a_hidden_oscillator_is_found_among_the_modes_and_above_them_all(times):
    highest = 6.1
    rides = {"mass_kg": 0.3, "frequency_hz": times * highest, "damping_n_s_per_m": 0.6}
    effect = Effect("extra_dof", Place("node", "m3"), rides)
    trials = recorded(EVERY, (effect,))
    before = refit_within_tolerances(refit(Plant.of(EVERY, kinds=KINDS), trials), trials)
    tried = library_candidates(before, locate(before, trials), KINDS)
    best = max((one for one in tried if one.effect.kind == "extra_dof"), key=lambda c: c.score)
    assert best.effect.place == effect.place
    assert best.effect.parameters["frequency_hz"] == pytest.approx(times * highest, rel=0.15)


def test_no_law_is_tried_at_a_node_of_beams():
    nodes = tuple(dataclasses.replace(node, kind="beam") for node in ONE.nodes)
    turning = dataclasses.replace(ONE, nodes=nodes)
    at_nodes = [kind for kind in KINDS.values() if kind.where == "node"]
    place = Place("node", ONE.nodes[0].id)
    assert any(is_applicable(kind, place, ONE) for kind in at_nodes)
    assert not any(is_applicable(kind, place, turning) for kind in at_nodes)
