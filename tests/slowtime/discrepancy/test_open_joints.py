"""Places that a model has no element for."""

import dataclasses
import itertools

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import is_applicable
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.model_evidence import evidence
from slowtime.discrepancy.open_joints import (
    LIKELY_JOINTS,
    MOST_JOINTS,
    with_open_joints,
    without_unused_joints,
)
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import (
    BASE,
    Beam,
    Description,
    Input,
    Node,
    OpenJoint,
    Sensor,
    Spring,
    Support,
    Tolerance,
    assemble,
)
from slowtime.dynamics.effects import Place, catalogue
from slowtime.dynamics.plant import Plant


def joints_of(description):
    return {e.id: e.between for e in description.elements if isinstance(e, OpenJoint)}


@pytest.mark.parametrize("size", range(1, 7))
def test_every_two_points_are_joined_or_open_and_none_twice(size):
    described = with_open_joints(chain([1.0] * size, [100.0] * size))
    points = [BASE, *(node.id for node in described.nodes)]
    pairs = [frozenset(e.between) for e in described.elements]
    assert len(set(pairs)) == len(pairs)
    assert set(pairs) == set(map(frozenset, itertools.combinations(points, 2)))
    assert {joint.among for joint in described.elements if isinstance(joint, OpenJoint)} <= {
        len(joints_of(described))
    }


def test_open_joints_change_nothing_that_moves():
    given = chain([1.0, 2.0, 3.0], [100.0, 200.0, 300.0], dampings_n_s_per_m=[1.0, 2.0, 3.0])
    one, other = assemble(given), assemble(with_open_joints(given))
    for what in ("mass", "damping", "stiffness"):
        np.testing.assert_array_equal(getattr(one, what), getattr(other, what))


def test_only_those_with_an_effect_stay_and_are_elements_of_their_own():
    given = chain([1.0, 2.0, 3.0], [100.0, 200.0, 300.0])
    opened = with_open_joints(given)
    assert without_unused_joints(opened) == given
    ground = next(n for n, pair in joints_of(opened).items() if BASE in pair)
    effect = {"effect": "missing_spring", "element": ground, "k_n_per_m": 9.0}
    kept = without_unused_joints(dataclasses.replace(opened, effects=(effect,)))
    assert [e.id for e in kept.elements] == [*(e.id for e in given.elements), ground]
    assert {type(e) for e in kept.elements} == {Spring}


def test_of_many_pairs_the_likeliest_are_joined():
    given = chain([1.0] * 20, [100.0] * 20)

    def likely(described, pairs, most):
        assert described == given
        assert len(pairs) == 20 * 21 / 2 - 20
        return pairs[-most:]

    joints = joints_of(with_open_joints(given, likely))
    assert len(joints) == LIKELY_JOINTS
    assert ("m18", "m20") in joints.values()
    few = chain([1.0] * 4, [100.0] * 4)
    refused = with_open_joints(few, lambda *_: pytest.fail("asked"))
    assert refused == with_open_joints(few)
    assert len(joints_of(with_open_joints(given))) == MOST_JOINTS


def test_a_name_that_is_taken_is_not_given_again():
    nodes = tuple(Node(id=n, mass_kg=1.0) for n in ("m1", "m2"))
    elements = (
        Spring(id="base-m2", between=(BASE, "m1"), stiffness_n_per_m=1.0),
        Spring(id="s2", between=("m1", "m2"), stiffness_n_per_m=1.0),
    )
    opened = with_open_joints(Description(name="d", nodes=nodes, elements=elements))
    assert joints_of(opened) == {"base-m2'": (BASE, "m2")}


def test_names_differ_where_the_names_of_points_run_into_each_other():
    nodes = tuple(Node(id=name, mass_kg=1.0) for name in ("a", "b-c", "a-b", "c"))
    elements = tuple(
        Spring(id=f"s{n}", between=(BASE, node.id), stiffness_n_per_m=1.0)
        for n, node in enumerate(nodes)
    )
    joints = joints_of(with_open_joints(Description(name="d", nodes=nodes, elements=elements)))
    assert len(joints) == 6
    assert {"a-b-c", "a-b-c'"} <= set(joints)


def test_a_support_that_an_input_moves_is_a_place_of_its_own():
    given = dataclasses.replace(
        chain([1.0, 2.0], [100.0, 200.0]),
        supports=(Support(id="wall"),),
        inputs=(Input(channel="x", kind="imposed_displacement", node="wall", unit="m"),),
    )
    pairs = {("base", "m2"), ("wall", "m1"), ("wall", "m2")}
    assert set(joints_of(with_open_joints(given)).values()) == pairs
    # One that no input moves is the ground.
    still = dataclasses.replace(given, inputs=())
    assert set(joints_of(with_open_joints(still)).values()) == {("base", "m2")}


def test_beside_a_moving_base_a_neighbour_may_stand_still():
    given = dataclasses.replace(
        chain([1.0, 2.0], [100.0, 200.0]),
        inputs=(Input(channel="x", kind="base_acceleration", unit="m/s^2"),),
    )
    opened = with_open_joints(given)
    pairs = {("base", "m2"), ("still", "m1"), ("still", "m2")}
    assert set(joints_of(opened).values()) == pairs
    assert without_unused_joints(opened) == given
    drag = {"effect": "quadratic_damping", "element": "still-m2", "c2_n_s2_per_m2": 1.0}
    used = without_unused_joints(dataclasses.replace(opened, effects=(drag,)))
    assert [one.id for one in used.supports] == ["still"]
    # Where a force drives the structure, such a neighbour is the ground.
    force = Input(channel="u", kind="force", node="m1", unit="N")
    forced = dataclasses.replace(given, inputs=(force,))
    assert set(joints_of(with_open_joints(forced)).values()) == {("base", "m2")}


def test_nodes_of_beams_may_be_joined_too():
    beam = {"length_m": 1.0, "bending_stiffness_n_m2": 1.0, "mass_kg_per_m": 1.0}
    given = Description(
        name="d",
        nodes=tuple(Node(id=name, kind="beam") for name in ("mid", "tip")),
        elements=(
            Beam(id="b1", between=(BASE, "mid"), **beam),
            Beam(id="b2", between=("mid", "tip"), **beam),
        ),
    )
    assert set(joints_of(with_open_joints(given)).values()) == {(BASE, "tip")}


def test_a_joint_lacks_a_spring_and_an_element_may_have_changed():
    opened = with_open_joints(chain([1.0, 2.0], [100.0, 200.0]))
    own, (new,) = opened.elements[0].id, joints_of(opened)
    kinds = catalogue()
    for name in ("missing_spring", "missing_damper"):
        assert not is_applicable(kinds[name], Place("element", own), opened)
        assert is_applicable(kinds[name], Place("element", new), opened)
    for name in ("stiffness_loss", "viscous_damping"):
        assert is_applicable(kinds[name], Place("element", own), opened)
        assert not is_applicable(kinds[name], Place("element", new), opened)
    for name in ("coulomb", "quadratic_damping"):
        assert is_applicable(kinds[name], Place("element", own), opened)
        assert is_applicable(kinds[name], Place("element", new), opened)


def test_many_joints_do_not_outvote_one_element():
    given = dataclasses.replace(
        chain([1.0, 1.0, 1.0], [100.0, 100.0, 100.0], dampings_n_s_per_m=[1.0, 1.0, 1.0]),
        inputs=(Input(channel="u", kind="force", node="m3", unit="N"),),
        sensors=(Sensor(channel="a", quantity="acceleration", node="m3", unit="m/s^2"),),
        tolerance=Tolerance(stiffness=0.02, damping=0.2),
    )  # fmt: skip
    opened = with_open_joints(given)
    rng = np.random.default_rng(0)
    u = rng.normal(size=(600, 1))
    y = Plant.of(given).simulate(Plant.of(given).values, u, 50.0)
    trial = Trial(inputs=u, outputs=y + 0.01 * rng.normal(size=y.shape), rate_hz=50.0)
    kinds = catalogue()

    def score(place):
        effect = {"effect": "quadratic_damping", "element": place, "c2_n_s2_per_m2": 0.0}
        described = dataclasses.replace(opened, effects=(effect,))
        fit = refit(Plant.of(described), [trial])
        return evidence(fit, kinds) + fit.cost / 2

    joints = joints_of(opened)
    assert score(opened.elements[0].id) - score(next(iter(joints))) == pytest.approx(
        np.log(len(joints))
    )


@pytest.mark.long
def test_what_is_found_is_an_element_of_the_model_and_said_to_be_new():
    given = dataclasses.replace(
        chain([3.0, 2.0], [6000.0, 4000.0], dampings_n_s_per_m=[4.0, 3.0]),
        inputs=(Input(channel="u", kind="force", node="m2", unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
            for i in (1, 2)
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.2),
    )
    ground = Spring(id="ground", between=(BASE, "m2"))
    effect = {"effect": "missing_spring", "element": "ground", "k_n_per_m": 600.0}
    real = dataclasses.replace(given, elements=(*given.elements, ground), effects=(effect,))
    plant, rng = Plant.of(real), np.random.default_rng(3)

    def record():
        u = 20.0 * rng.normal(size=(3000, 1))
        y = plant.simulate(plant.values, u, 100.0)
        noise = 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
        return Trial(inputs=u, outputs=y + noise, rate_hz=100.0)

    answer = diagnose(
        Campaign(description=given, trials=(record(), record()), holdout=(record(),))
    )
    (found,) = answer.effects
    assert (found.effect.kind, found.effect.place.id) == ("missing_spring", "base-m2")
    told = found.numbers["k_n_per_m"]
    assert abs(told.value - 600.0) < 3 * told.sd
    assert answer.augmented.elements[-1] == Spring(id="base-m2", between=(BASE, "m2"))
    assert [e.id for e in answer.nominal.elements] == [e.id for e in given.elements]
    assert any("base-m2 stands for what joins base and m2" in note for note in answer.notes)
