import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime.finite_elements.frame import (
    Bar,
    Beam,
    Frame,
    MultiPointConstraint,
    Parameter,
    PointMass,
    RigidLink,
    Spring,
    Support,
)
from slowtime.finite_elements.sections import Material, Section, rectangle, tube
from tests.slowtime.finite_elements.frames import FLAT, STEEL, line_of_beams, small_tower

SQUARE = rectangle(0.05, 0.05)
BENDING = STEEL.young_pa * FLAT.inertia_y_m4
LINE_MASS = STEEL.density_kg_m3 * FLAT.area_m2


def solve(model, forces):
    """Displacements over all degrees of freedom under forces by name of node and direction."""
    load = np.zeros(model.dofs.size)
    for (node, direction), value in forces.items():
        load[model.dofs.find(node, direction)] += value
    own = sparse.linalg.spsolve(sparse.csc_array(model.stiffness), model.rows(load[None])[0])
    return model.expand(own[:, None])[:, 0]


def at(model, displacement, node, direction):
    return displacement[model.dofs.find(node, direction)]


def free(frame):
    return assemble(dataclasses.replace(frame, supports=()))


def rigid_motions(model):
    """Six columns: translations along, and rotations about, x, y and z."""
    x = model.dofs.coordinates
    motions = np.zeros((model.dofs.size, 6))
    for d in range(6):
        turn = np.eye(3)[d - 3]
        for k in range(len(x)):
            move = np.eye(3)[d] if d < 3 else np.cross(turn, x[k])
            motions[6 * k : 6 * k + 3, d] = move
            if d >= 3:
                motions[6 * k + 3 : 6 * k + 6, d] = turn
    return motions


def mixed_frame():
    tower = small_tower(2)
    extra = Spring(
        name="s",
        ends=("1.0", "2.2"),
        translation_n_per_m=(1e6, 2e6, 3e6),
        rotation_nm_per_rad=(1e4, 2e4, 3e4),
    )
    bar = Bar(name="bar", ends=("0.0", "2.2"), section=SQUARE, material=STEEL)
    body = PointMass(
        name="m",
        node="2.1",
        mass_kg=50.0,
        inertia_kg_m2=(1.0, 2.0, 3.0),
        offset_m=(0.3, 0.1, 0.5),
    )
    euler = Beam(
        name="e",
        ends=("0.1", "2.3"),
        section=FLAT,
        material=STEEL,
        theory="euler",
        orientation=(1.0, 2.0, 0.5),
    )
    return dataclasses.replace(
        tower, springs=(extra,), bars=(bar,), masses=(body,), beams=(*tower.beams, euler)
    )


def test_rigid_motions_strain_nothing_whatever_the_elements():
    model = free(mixed_frame())
    motions = rigid_motions(model)
    scale = np.abs(model.stiffness.diagonal()).max()
    assert np.abs(model.stiffness @ motions).max() < 1e-9 * scale


def test_rigid_motions_have_the_mass_and_inertia_of_the_bodies():
    frame = mixed_frame()
    model = free(frame)
    motions = rigid_motions(model)
    masses = motions.T @ (model.mass @ motions)
    x = dict(zip(frame.node_names, frame.coordinates, strict=True))
    total = 50.0 + sum(
        b.material.density_kg_m3
        * b.section.area_m2
        * np.linalg.norm(x[b.ends[1]] - x[b.ends[0]])
        for b in (*frame.beams, *frame.bars)
    )
    np.testing.assert_allclose(np.diag(masses)[:3], total, rtol=1e-12)
    np.testing.assert_allclose(masses[:3, :3], total * np.eye(3), atol=1e-8 * total)


def test_a_point_mass_off_its_node_has_its_parallel_axis_inertia():
    body = PointMass(
        name="m", node="a", mass_kg=2.0, inertia_kg_m2=(1.0, 2.0, 3.0), offset_m=(0.5, 0.0, 0.0)
    )
    frame = Frame(node_names=("a",), coordinates=np.zeros((1, 3)), masses=(body,))
    mass = assemble(frame).mass.toarray()
    np.testing.assert_allclose(np.diag(mass), [2, 2, 2, 1, 2 + 0.5, 3 + 0.5])
    assert mass[1, 5] == pytest.approx(2.0 * 0.5)
    assert mass[2, 4] == pytest.approx(-2.0 * 0.5)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 0, 1), (1, -2, 3)])
def test_a_cantilever_bends_as_in_the_textbook_in_any_direction(direction):
    frame = line_of_beams(3, section=tube(0.1, 0.01), direction=direction)
    model = assemble(frame)
    across = np.cross(direction, [0.3, 0.9, -0.2])
    across = across / np.linalg.norm(across)
    forces = {("3", way): 1000.0 * v for way, v in zip(("ux", "uy", "uz"), across, strict=True)}
    moved = solve(model, forces)
    tip = np.array([at(model, moved, "3", way) for way in ("ux", "uy", "uz")])
    bending = STEEL.young_pa * tube(0.1, 0.01).inertia_y_m4
    np.testing.assert_allclose(tip, 1000.0 * 2.0**3 / (3 * bending) * across, rtol=1e-9)


def test_shear_deformation_adds_its_part_exactly():
    section = rectangle(0.2, 0.5)
    model = assemble(line_of_beams(2, section=section, theory="timoshenko"))
    moved = solve(model, {("2", "uz"): 1.0})
    shear = STEEL.shear_pa * section.shear_z_m2
    # Default orientation: the local y axis of a beam along x is the global z axis.
    shear_area, inertia = STEEL.shear_pa * section.shear_y_m2, section.inertia_z_m4
    assert shear == pytest.approx(shear_area)
    expected = 2.0**3 / (3 * STEEL.young_pa * inertia) + 2.0 / shear_area
    assert at(model, moved, "2", "uz") == pytest.approx(expected, rel=1e-10)


def test_the_orientation_turns_the_strong_axis():
    flat = assemble(line_of_beams(1, orientation=(0.0, 1.0, 0.0)))
    moved = solve(flat, {("1", "uy"): 1.0})
    expected = 2.0**3 / (3 * STEEL.young_pa * FLAT.inertia_z_m4)
    assert at(flat, moved, "1", "uy") == pytest.approx(expected, rel=1e-10)
    moved = solve(flat, {("1", "uz"): 1.0})
    expected = 2.0**3 / (3 * STEEL.young_pa * FLAT.inertia_y_m4)
    assert at(flat, moved, "1", "uz") == pytest.approx(expected, rel=1e-10)


def test_patch_uniform_strain_is_exact_on_an_uneven_mesh():
    x = np.array([0.0, 0.3, 0.37, 1.4, 2.0])
    frame = line_of_beams(4)
    frame = dataclasses.replace(frame, coordinates=np.column_stack([x, 0 * x, 0 * x]))
    model = assemble(frame)
    pulled = solve(model, {("4", "ux"): 2e5, ("4", "ry"): 300.0})
    strain = 2e5 / (STEEL.young_pa * FLAT.area_m2)
    # The local y axis is the global z axis, so bending in the x-z plane uses inertia_z.
    curvature = 300.0 / (STEEL.young_pa * FLAT.inertia_z_m4)
    for node, place in zip(frame.node_names, x, strict=True):
        assert at(model, pulled, node, "ux") == pytest.approx(strain * place, abs=1e-13)
        assert at(model, pulled, node, "ry") == pytest.approx(curvature * place, abs=1e-12)
        assert at(model, pulled, node, "uz") == pytest.approx(
            -curvature * place**2 / 2, abs=1e-12
        )


def test_displacements_are_reciprocal():
    model = assemble(mixed_frame())
    one = solve(model, {("1.0", "ux"): 1.0})
    other = solve(model, {("2.2", "rz"): 1.0})
    assert at(model, one, "2.2", "rz") == pytest.approx(at(model, other, "1.0", "ux"), rel=1e-8)


def test_frequencies_do_not_change_when_the_structure_is_turned():
    frame = mixed_frame()
    frame = dataclasses.replace(frame, springs=(), masses=())
    turn = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    beams = tuple(
        dataclasses.replace(b, orientation=tuple(turn @ _plane(frame, b))) for b in frame.beams
    )
    turned = dataclasses.replace(frame, coordinates=frame.coordinates @ turn.T, beams=beams)
    one = nominal_modes(assemble(frame), 10).frequency_hz
    other = nominal_modes(assemble(turned), 10).frequency_hz
    np.testing.assert_allclose(other, one, rtol=1e-8)


def _plane(frame, beam):
    """The orientation that `element_axes` chooses where none is given."""
    if any(beam.orientation):
        return np.array(beam.orientation)
    place = dict(zip(frame.node_names, frame.coordinates, strict=True))
    along = place[beam.ends[1]] - place[beam.ends[0]]
    return np.array([0.0, 1.0, 0.0] if not along[:2].any() else [0.0, 0.0, 1.0])


def test_a_space_truss_of_three_bars_is_solved_by_hand():
    # Joints on a circle of radius 3 m, loaded apex 4 m above: bars of length 5 m.
    angles = 2 * np.pi * np.arange(3) / 3
    feet = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), 0 * angles])
    frame = Frame(
        node_names=("a", "b", "c", "top"),
        coordinates=np.vstack([feet, [0, 0, 4.0]]),
        bars=tuple(
            Bar(name=f"bar {n}", ends=(n, "top"), section=SQUARE, material=STEEL) for n in "abc"
        ),
        supports=tuple(Support(node=n, directions=("ux", "uy", "uz")) for n in "abc"),
    )
    model = assemble(frame)
    assert model.size == 3
    axial = STEEL.young_pa * SQUARE.area_m2 / 5.0
    # Vertical stiffness: 3 EA/L sin^2, horizontal: 3/2 EA/L cos^2.
    moved = solve(model, {("top", "uz"): -1e4})
    assert at(model, moved, "top", "uz") == pytest.approx(-1e4 / (3 * axial * 0.64), rel=1e-12)
    moved = solve(model, {("top", "ux"): 1e4})
    assert at(model, moved, "top", "ux") == pytest.approx(1e4 / (1.5 * axial * 0.36), rel=1e-12)


def test_a_portal_frame_sways_as_in_the_textbook():
    """Fixed-base portal with a horizontal force at the beam: slope-deflection solution."""
    height, span, inertia = 3.0, 4.0, 1e-5
    rigid_axially = Section(
        area_m2=10.0, inertia_y_m4=inertia, inertia_z_m4=inertia, torsion_m4=1e-5
    )
    material = Material(young_pa=2e11)
    corners = {"a": (0, 0, 0), "b": (0, 0, height), "c": (span, 0, height), "d": (span, 0, 0)}
    frame = Frame(
        node_names=tuple(corners),
        coordinates=np.array(list(corners.values()), dtype=float),
        beams=tuple(
            Beam(
                name=i + j,
                ends=(i, j),
                section=rigid_axially,
                material=material,
                theory="euler",
            )
            for i, j in (("a", "b"), ("b", "c"), ("c", "d"))
        ),
        supports=(Support(node="a"), Support(node="d")),
    )
    model = assemble(frame)
    moved = solve(model, {("b", "ux"): 1.0})
    # With k = I_beam h / (I_column L): sway = F h^3 (2 + 3 k) / (12 E I (1 + 6 k)).
    k = height / span
    expected = height**3 * (2 + 3 * k) / (12 * 2e11 * inertia * (1 + 6 * k))
    assert at(model, moved, "b", "ux") == pytest.approx(expected, rel=1e-4)


def test_parameters_scale_their_groups_only():
    frame = line_of_beams(4)
    both = Parameter(name="both", groups=("g1", "g2"), acts_on="both")
    model = assemble(dataclasses.replace(frame, parameters=(both,)))
    stiffness, mass = model.at(np.array([0.2]))
    changed = dataclasses.replace(
        STEEL, young_pa=1.2 * STEEL.young_pa, density_kg_m3=1.2 * STEEL.density_kg_m3
    )
    beams = tuple(
        dataclasses.replace(b, material=changed if b.group in both.groups else STEEL)
        for b in frame.beams
    )
    direct = assemble(dataclasses.replace(frame, beams=beams))
    np.testing.assert_allclose(
        stiffness.toarray(), direct.stiffness.toarray(), rtol=1e-9, atol=1
    )
    np.testing.assert_allclose(mass.toarray(), direct.mass.toarray(), rtol=1e-12, atol=1e-12)


def test_a_rigid_link_carries_its_node_and_its_mass():
    body = PointMass(name="m", node="far", mass_kg=7.0)
    base = line_of_beams(2)
    linked = dataclasses.replace(
        base,
        node_names=(*base.node_names, "far"),
        coordinates=np.vstack([base.coordinates, [2.0, 0.4, 0.3]]),
        masses=(body,),
        links=(RigidLink(leading="2", following="far"),),
    )
    offset = dataclasses.replace(body, node="2", offset_m=(0.0, 0.4, 0.3))
    direct = dataclasses.replace(base, masses=(offset,))
    one, other = assemble(linked), assemble(direct)
    np.testing.assert_allclose(
        nominal_modes(one, 6).frequency_hz, nominal_modes(other, 6).frequency_hz, rtol=1e-9
    )
    moved = solve(one, {("2", "rz"): 100.0})
    turned = at(one, moved, "2", "rz")
    assert at(one, moved, "far", "ux") == pytest.approx(
        at(one, moved, "2", "ux") - 0.4 * turned, rel=1e-12
    )


def test_a_multi_point_constraint_holds_its_relation():
    tie = MultiPointConstraint(terms=(("3", "uz", 1.0), ("1", "uz", -2.0)))
    model = assemble(dataclasses.replace(line_of_beams(3), constraints=(tie,)))
    moved = solve(model, {("2", "uz"): 1.0})
    assert at(model, moved, "3", "uz") == pytest.approx(
        2 * at(model, moved, "1", "uz"), rel=1e-12
    )


def test_conditions_that_contradict_are_refused():
    tie = MultiPointConstraint(terms=(("0", "uz", 1.0), ("1", "uz", -2.0)))
    with pytest.raises(ValueError, match="Two constraints eliminate"):
        assemble(dataclasses.replace(line_of_beams(3), constraints=(tie,)))
    with pytest.raises(ValueError, match=r"names the node '9', which does not exist"):
        dataclasses.replace(
            line_of_beams(1), masses=(PointMass(name="m", node="9", mass_kg=1.0),)
        )
    with pytest.raises(ValueError, match="joins two nodes at the same place"):
        assemble(dataclasses.replace(line_of_beams(2), coordinates=np.zeros((3, 3))))
    with pytest.raises(ValueError, match="lies along its axis"):
        assemble(line_of_beams(1, orientation=(2.0, 0.0, 0.0)))


def test_a_space_frame_moves_as_a_textbook_prints():
    # A. J. M. Ferreira, "MATLAB Codes for Finite Element Analysis", Springer (2009), first
    # example of section 8.3: three beams that meet at node 1, in metres and radians; printed
    # digits as the tests of the package Asap (Julia) quote them.
    printed = [-7.05e-6, -7e-8, 1.418e-5, 1.45e-6, 1.75e-6, 1.14e-6]
    steel = Material(young_pa=210e9, poisson=210 / (2 * 84) - 1, density_kg_m3=0.0)
    section = Section(area_m2=0.02, inertia_y_m4=1e-4, inertia_z_m4=2e-4, torsion_m4=5e-5)
    # The book takes y of the upright beam, along which the global y axis lies, along x.
    across = {"2": (0.0, 1.0, 0.0), "3": (0.0, 1.0, 0.0), "4": (1.0, 0.0, 0.0)}
    beams = tuple(
        Beam(
            name=f"b{end}",
            ends=("1", end),
            section=section,
            material=steel,
            theory="euler",
            orientation=orientation,
        )
        for end, orientation in across.items()
    )
    frame = Frame(
        node_names=("1", "2", "3", "4"),
        coordinates=np.array([[0, 0, 0], [3, 0, 0], [0, 0, -3], [0, -4, 0]], dtype=float),
        beams=beams,
        supports=tuple(Support(node=end) for end in across),
    )
    model = assemble(frame)
    moved = solve(model, {("1", "ux"): -10e3, ("1", "uz"): 20e3})
    found = [at(model, moved, "1", way) for way in ("ux", "uy", "uz", "rx", "ry", "rz")]
    np.testing.assert_allclose(found, printed, rtol=0, atol=5.1e-9)


def test_released_ends_keep_the_mass_of_a_beam_that_moves_as_a_whole():
    whole = line_of_beams(1, supports=())
    hinged = dataclasses.replace(
        whole, beams=(dataclasses.replace(whole.beams[0], released=(("rz", "ry"), ("rz",))),)
    )
    for frame in (whole, hinged):
        model: Any = assemble(frame)
        for axis in ("ux", "uy", "uz"):
            unit = np.zeros(model.dofs.size)
            unit[[model.dofs.find(node, axis) for node in ("0", "1")]] = 1.0
            own = model.rows(unit[None])[0]
            assert own @ model.mass @ own == pytest.approx(2.0 * LINE_MASS)
