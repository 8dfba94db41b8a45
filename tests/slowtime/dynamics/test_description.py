import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.dynamics.builders import beam, chain, shear_frame
from slowtime.dynamics.description import (
    BASE,
    Beam,
    Description,
    DescriptionError,
    Input,
    Node,
    Sensor,
    Spring,
    assemble,
    assemble_parts,
)
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.units import UNITS, unit_factor

RIG = Description(
    name="rig",
    nodes=(Node(id="m1", mass_kg=1.9), Node(id="m2", mass_kg=2.1)),
    elements=(
        Spring(id="j0", between=(BASE, "m1"), stiffness_n_per_m=4100.0, damping_n_s_per_m=2.3),
        Spring(id="j1", between=("m1", "m2"), stiffness_n_per_m=3900.0, damping_n_s_per_m=2.2),
    ),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=(Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),),
)
BEAM = beam(1.2, 50.0, 2.0, elements=4, supports="simply supported", damping_s=1e-3)


def test_matrices_are_what_the_elements_do():
    structure = assemble(RIG)
    np.testing.assert_array_equal(structure.mass, np.diag([1.9, 2.1]))
    np.testing.assert_allclose(structure.stiffness, [[8000, -3900], [-3900, 3900]])
    np.testing.assert_allclose(structure.damping, [[4.5, -2.2], [-2.2, 2.2]])
    assert structure.names == ("m1", "m2")
    np.testing.assert_array_equal(structure.influence, [1, 1])


def test_an_element_may_be_named_either_way_round():
    j0, j1 = RIG.elements
    assert isinstance(j1, Spring)
    turned = dataclasses.replace(j1, between=("m2", "m1"))
    swapped = dataclasses.replace(RIG, elements=(turned, j0))
    np.testing.assert_array_equal(assemble(swapped).stiffness, assemble(RIG).stiffness)


@pytest.mark.parametrize("description", [RIG, BEAM], ids=["rig", "beam"])
def test_parts_add_up_to_the_whole(description):
    whole, parts = assemble(description), assemble_parts(description)
    assert parts.names == whole.names
    for matrix, of_parts in (
        (whole.mass, parts.mass_parts),
        (whole.damping, parts.damping_parts),
        (whole.stiffness, parts.stiffness_parts),
    ):
        np.testing.assert_allclose(sum(of_parts.values()), matrix, atol=1e-9)


@given(st.lists(st.floats(-0.5, 0.5), min_size=4, max_size=4))
def test_parts_follow_their_parameters(changes):
    masses, springs = [1.0, 2.0, 3.0], [900.0, 800.0, 700.0, 600.0]
    parts = assemble_parts(chain(masses, springs))
    changed = [k * (1 + theta) for k, theta in zip(springs, changes, strict=True)]
    by_parts = sum(
        (1 + theta) * part
        for theta, part in zip(changes, parts.stiffness_parts.values(), strict=True)
    )
    np.testing.assert_allclose(assemble(chain(masses, changed)).stiffness, by_parts, atol=1e-9)


@pytest.mark.parametrize(
    ("supports", "betas"),
    [
        ("cantilever", [1.875104069, 4.694091133]),
        ("simply supported", [np.pi, 2 * np.pi]),
        ("clamped", [4.730040745, 7.853204624]),
        ("propped", [3.926602312, 7.068582746]),
        ("free", [0.0, 0.0, 4.730040745]),
    ],
)
def test_a_beam_has_the_frequencies_of_euler_and_bernoulli(supports, betas):
    length, stiffness, mass = 1.5, 30.0, 0.8
    errors = []
    for elements in (8, 16):
        description = beam(length, stiffness, mass, elements=elements, supports=supports)
        omega = undamped_modes(assemble(description)).angular_frequency[: len(betas)]
        truth = np.square(betas) * np.sqrt(stiffness / mass) / length**2
        scale = np.where(truth > 0, truth, 1.0)
        errors.append((omega - truth)[-1] / scale[-1])
        np.testing.assert_allclose(omega, truth, rtol=1e-3, atol=1e-3)
    # Cubic shape functions: from above, sixteen times nearer with half the length.
    assert errors[0] > 0
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


def test_a_heavy_tip_makes_a_cantilever_a_spring():
    bare = beam(2.0, 60.0, 1e-6, elements=3, tip_mass_kg=5.0)
    omega = undamped_modes(assemble(bare)).angular_frequency[0]
    assert omega == pytest.approx(np.sqrt(3 * 60.0 / 2.0**3 / 5.0), rel=1e-6)


def test_a_beam_carried_along_weighs_what_it_weighs():
    """The base feels mass times acceleration of everything that is not the base's own."""
    structure = assemble(beam(2.0, 60.0, 1.5, elements=3, tip_mass_kg=5.0))
    assert structure.influence is not None
    assert structure.base_mass is not None
    carried = structure.mass @ structure.influence + structure.base_mass
    # The half element shape at the clamp moves with the base: 156/420 + 54/420 of its mass.
    own = 1.5 * 2.0 / 3 * (156 + 54) / 420
    assert carried @ structure.influence == pytest.approx(1.5 * 2.0 + 5.0 - own)


def test_a_held_coordinate_is_no_degree_of_freedom():
    assert BEAM.dofs[0] == "n0.rotation"
    assert "n4" not in BEAM.dofs
    guided = Node(id="g", kind="beam", mass_kg=1.0, held=("rotation",))
    assert guided.dofs == ("g",)


def test_a_chain_has_the_dampers_of_rayleigh():
    structure = assemble(chain([1.0, 2.0], [30.0, 20.0, 10.0], rayleigh=(0.3, 0.01)))
    np.testing.assert_allclose(
        structure.damping, 0.3 * structure.mass + 0.01 * structure.stiffness
    )


def test_a_frame_is_a_chain_of_floors():
    frame = shear_frame([1e4, 1e4], [5e6, 5e6])
    assert frame.dofs == ("floor1", "floor2")
    assert [element.id for element in frame.elements] == ["storey1", "storey2"]
    assert [sensor.channel for sensor in frame.sensors] == ["a_floor1", "a_floor2"]


def changed(**what):
    return lambda: dataclasses.replace(RIG, **what)


ONE = Node(id="m1", mass_kg=1.0)


@pytest.mark.parametrize(
    ("make", "where", "words"),
    [
        (changed(nodes=()), ("nodes",), "Give at least one"),
        (changed(nodes=(ONE, ONE)), ("nodes", 1, "id"), "used twice"),
        (changed(nodes=(Node(id="base", mass_kg=1.0),)), ("nodes", 0, "id"), "ground"),
        (changed(nodes=(Node(id="m1"),)), ("nodes", 0, "mass_kg"), "positive mass"),
        (
            changed(nodes=(Node(id="m1", mass_kg=1.0, held=("rotation",)),)),
            ("nodes", 0, "held"),
            "kind: beam",
        ),
        (
            changed(nodes=(Node(id="m", kind="beam", held=("translation", "rotation")),)),
            ("nodes",),
            "nothing can move",
        ),
        (
            changed(elements=(Spring(id="j", between=("m1", "m9")),)),
            ("elements", 0, "between"),
            "No node is called 'm9'. There are: base, m1, m2",
        ),
        (
            changed(elements=(Spring(id="j", between=(BASE, "m1"), stiffness_n_per_m=1.0),)),
            ("nodes", 1, "id"),
            "'m2' hangs in the air",
        ),
        (
            changed(elements=(Spring(id="j", between=("m1", "m1")),)),
            ("elements", 0, "between"),
            "to itself",
        ),
        (
            changed(
                elements=(
                    Beam(
                        id="b",
                        between=(BASE, "m1"),
                        length_m=1.0,
                        bending_stiffness_n_m2=1.0,
                        mass_kg_per_m=1.0,
                    ),
                )
            ),
            ("elements", 0, "between"),
            "has no rotation",
        ),
        (
            changed(inputs=(Input(channel="u", kind="force", unit="N"),)),
            ("inputs", 0),
            "Name it as `node`",
        ),
        (
            changed(inputs=(Input(channel="u", kind="force", node="m1", unit="V"),)),
            ("inputs", 0, "unit"),
            "not a valid unit of force. Allowed: N",
        ),
        (
            changed(
                inputs=(Input(channel="u", kind="base_acceleration", node="m1", unit="g"),)
            ),
            ("inputs", 0, "node"),
            "Leave `node` out",
        ),
        (
            changed(sensors=(Sensor(channel="x", quantity="velocity", node="m1", unit="m"),)),
            ("sensors", 0, "unit"),
            "not a valid unit of velocity",
        ),
        (
            changed(sensors=RIG.sensors * 2),
            ("sensors", 1, "channel"),
            "used twice",
        ),
        (
            lambda: dataclasses.replace(BEAM, unit_of_coordinate="rad", sensors=()),
            ("elements", 0, "kind"),
            "bends in metres",
        ),
    ],
)
def test_a_description_that_contradicts_itself_says_where(make, where, words):
    with pytest.raises(DescriptionError, match=words) as caught:
        make()
    assert caught.value.where == where


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: chain([1.0], [1.0, 1.0, 1.0]), "one for each mass"),
        (lambda: chain([1.0], [1.0], dampings_n_s_per_m=[1.0, 2.0]), "Give 1, or none"),
        (lambda: shear_frame([1.0], [1.0, 1.0]), "one storey for each floor"),
        (lambda: beam(1.0, 1.0, 1.0, supports="glued"), "Allowed: cantilever"),
        (lambda: beam(1.0, 1.0, 1.0, elements=1), "too coarse"),
    ],
)
def test_a_structure_that_cannot_be_built_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_units_are_worth_what_they_are():
    assert unit_factor("g", "acceleration") == pytest.approx(9.80665)
    assert unit_factor("µm", "displacement") == 1e-6
    assert unit_factor("deg/s", "velocity", "rad") == pytest.approx(np.pi / 180)
    assert unit_factor("kN m", "force", "rad") == 1000.0
    assert all(factor > 0 for table in UNITS.values() for factor in table.values())
    with pytest.raises(ValueError, match="'N' is not a valid unit of torque"):
        unit_factor("N", "force", "rad")
