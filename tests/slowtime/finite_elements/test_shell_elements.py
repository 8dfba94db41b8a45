"""Shells of four corners: patch tests, Navier's and Leissa's plates, beams as folded plates."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime.finite_elements.frame import (
    Direction,
    Frame,
    MultiPointConstraint,
    Parameter,
    Shell,
    Support,
)
from slowtime.finite_elements.sections import Material
from tests.slowtime.finite_elements.test_assembly import at, rigid_motions, solve

STEEL = Material(young_pa=2.1e11, poisson=0.3, density_kg_m3=7850.0)
ALL: tuple[Direction, ...] = ("ux", "uy", "uz", "rx", "ry", "rz")


def plate(nx, ny, a=1.0, b=1.0, thickness=0.001, skew=0.0, turn=None, **conditions):
    """Shells over a rectangle in the x-y plane; inner nodes are moved by `skew` of a side."""
    rng = np.random.default_rng(3)
    names, places = [], []
    for i, j in itertools.product(range(nx + 1), range(ny + 1)):
        inside = 0 < i < nx and 0 < j < ny
        move = skew * rng.uniform(-1, 1, 2) * inside
        names.append(f"{i}.{j}")
        places.append([(i + move[0]) * a / nx, (j + move[1]) * b / ny, 0.0])
    shells = tuple(
        Shell(
            name=f"s{i}.{j}",
            corners=(f"{i}.{j}", f"{i + 1}.{j}", f"{i + 1}.{j + 1}", f"{i}.{j + 1}"),
            thickness_m=thickness,
            material=STEEL,
            group="left" if 2 * i < nx else "right",
        )
        for i, j in itertools.product(range(nx), range(ny))
    )
    coordinates = np.array(places) @ (np.eye(3) if turn is None else turn.T)
    return Frame(node_names=tuple(names), coordinates=coordinates, shells=shells, **conditions)


def edges(nx, ny):
    return [
        f"{i}.{j}" for i in range(nx + 1) for j in range(ny + 1) if i in (0, nx) or j in (0, ny)
    ]


def supported(nx, ny, clamped=False, **more):
    """Held in its plane throughout, and at the edges simply supported or clamped."""
    frame = plate(nx, ny, **more)
    flat = tuple(Support(node=name, directions=("ux", "uy", "rz")) for name in frame.node_names)
    held = []
    for name in edges(nx, ny):
        i, j = (int(k) for k in name.split("."))
        ways = {"uz"}
        if clamped or i in (0, nx):  # no twist along an edge that is hard supported
            ways.add("rx")
        if clamped or j in (0, ny):
            ways.add("ry")
        held.append(Support(node=name, directions=tuple(w for w in ALL if w in ways)))
    return dataclasses.replace(frame, supports=(*flat, *held))


def scale(thickness=0.001):
    rigidity = STEEL.young_pa * thickness**3 / (12 * (1 - STEEL.poisson**2))
    return np.sqrt(rigidity / (STEEL.density_kg_m3 * thickness))


def navier(a, b, count):
    """Frequencies of a simply supported thin plate [Hz]."""
    waves = [(m / a) ** 2 + (n / b) ** 2 for m in range(1, 12) for n in range(1, 12)]
    return np.pi / 2 * scale() * np.sort(waves)[:count]


def turned():
    return np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("turn", [np.eye(3), turned()])
def test_rigid_motions_strain_nothing_and_have_the_whole_mass(turn):
    frame = plate(3, 2, a=1.5, thickness=0.02, skew=0.25, turn=turn)
    model = assemble(frame)
    motions = rigid_motions(model)
    assert np.abs(model.stiffness @ motions).max() < 1e-9 * model.stiffness.diagonal().max()
    total = 7850.0 * 0.02 * 1.5
    np.testing.assert_allclose(
        (motions.T @ (model.mass @ motions))[:3, :3], total * np.eye(3), atol=1e-9 * total
    )


def test_only_rigid_motions_strain_nothing():
    model = assemble(plate(2, 2, thickness=0.05, skew=0.2))
    values = np.linalg.eigvalsh(model.stiffness.toarray())
    assert (values[:6] < 1e-9 * values[-1]).all()
    assert values[6] > 1e-7 * values[-1]


def patch(states):
    """Displacements of inner nodes where those of the edge are given by a state."""
    frame = plate(3, 3, thickness=0.1, skew=0.3)
    model = assemble(frame)
    x, y = frame.coordinates[:, 0], frame.coordinates[:, 1]
    exact = np.zeros((len(x), 6))
    for k, values in states(x, y).items():
        exact[:, k] = values
    whole = exact.ravel()
    inner = [k for k, name in enumerate(frame.node_names) if name not in edges(3, 3)]
    free = (6 * np.array(inner)[:, None] + np.arange(6)).ravel()
    held = np.setdiff1d(np.arange(len(whole)), free)
    stiffness = sparse.csr_array(model.stiffness)
    load = -stiffness[free][:, held] @ whole[held]
    found = sparse.linalg.spsolve(sparse.csc_array(stiffness[free][:, free]), load)
    return found, whole[free]


@pytest.mark.parametrize(
    "state",
    [
        lambda x, y: {0: 2 * x + y, 1: 3 * y + 5 * x, 5: np.full_like(x, 2.0)},
        # Constant curvatures: w, and the rotations w_y and -w_x about x and y.
        lambda x, y: {2: x**2 + 0.5 * y**2 + x * y, 3: y + x, 4: -2 * x - y},
    ],
)
def test_constant_strains_are_exact_on_skewed_elements(state):
    found, exact = patch(state)
    np.testing.assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


def test_a_simply_supported_plate_converges_to_navier_with_the_square_of_the_size():
    a, b = 1.0, 0.8
    exact = navier(a, b, 4)
    errors = np.array(
        [
            nominal_modes(assemble(supported(n, n, a=a, b=b)), 4).frequency_hz / exact - 1
            for n in (8, 16, 32)
        ]
    )
    assert (errors > 0).all()
    rates = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(rates, 2.0, atol=0.15)
    assert errors[-1].max() < 0.01


def test_a_square_clamped_plate_has_leissas_frequencies():
    # A. W. Leissa, "Vibration of Plates", NASA SP-160 (1969), table 4.22: omega a^2 / scale.
    leissa = np.array([35.992, 73.413, 73.413, 108.27, 131.64])
    coarse, fine = (
        nominal_modes(assemble(supported(n, n, clamped=True)), 5).frequency_hz for n in (16, 32)
    )
    richardson = (4 * fine - coarse) / 3
    np.testing.assert_allclose(2 * np.pi * richardson / scale(), leissa, rtol=1.5e-3)


def test_skewed_elements_converge_too():
    exact = navier(1.0, 1.0, 3)
    found = nominal_modes(assemble(supported(24, 24, skew=0.25)), 3).frequency_hz
    np.testing.assert_allclose(found, exact, rtol=0.015)


def test_a_thick_plate_has_the_frequencies_of_mindlin():
    thickness = 0.1
    rigidity = STEEL.young_pa * thickness**3 / (12 * (1 - STEEL.poisson**2))
    shear = 5 / 6 * STEEL.shear_pa * thickness
    mass, turning = 7850.0 * thickness, 7850.0 * thickness**3 / 12
    wave = 2 * np.pi**2
    # R. D. Mindlin, J. Appl. Mech. 18 (1951): lowest root for one half-wave along each side.
    middle = 1 + wave * (rigidity / shear + turning / mass)
    square = (
        middle - np.sqrt(middle**2 - 4 * wave**2 * rigidity * turning / (shear * mass))
    ) / (2 * turning / shear)
    exact = np.sqrt(square) / (2 * np.pi)
    coarse, fine = (
        nominal_modes(assemble(supported(n, n, thickness=thickness)), 1).frequency_hz[0]
        for n in (12, 24)
    )
    assert (4 * fine - coarse) / 3 == pytest.approx(exact, rel=2e-4)


def test_a_strip_bends_in_its_plane_as_a_beam():
    frame = plate(10, 1, a=2.0, b=0.1, thickness=0.01)
    held = tuple(Support(node=f"0.{j}") for j in (0, 1))
    model = assemble(dataclasses.replace(frame, supports=held))
    moved = solve(model, {("10.0", "uy"): 500.0, ("10.1", "uy"): 500.0})
    inertia, area = 0.01 * 0.1**3 / 12, 0.001
    exact = 1000.0 * 2.0**3 / (3 * STEEL.young_pa * inertia)
    exact += 1000.0 * 2.0 / (STEEL.shear_pa * area * 5 / 6)
    found = at(model, moved, "10.0", "uy")
    assert found == pytest.approx(exact, rel=0.01)


def test_a_strip_bends_out_of_its_plane_as_a_beam_at_any_angle():
    turn = turned()
    frame = plate(20, 2, a=2.0, b=0.1, thickness=0.01, turn=turn)
    held = tuple(Support(node=f"0.{j}") for j in (0, 1, 2))
    model = assemble(dataclasses.replace(frame, supports=held))
    found = nominal_modes(model, 1).frequency_hz[0]
    speed = np.sqrt(STEEL.young_pa * 0.01**2 / 12 / STEEL.density_kg_m3)
    assert found == pytest.approx(1.8751040687**2 / (2 * np.pi) * speed / 4.0, rel=0.006)


def test_a_parameter_scales_the_shells_of_its_group():
    frame = plate(4, 2, thickness=0.01, parameters=(Parameter(name="l", groups=("left",)),))
    (part,) = assemble(frame).stiffness_parts
    assert part is not None
    both = plate(4, 2, thickness=0.01)
    left = dataclasses.replace(both, shells=tuple(s for s in both.shells if s.group == "left"))
    np.testing.assert_allclose(part.toarray(), assemble_whole(left), atol=1e-6)


def assemble_whole(frame):
    """Stiffness over six degrees of freedom of every node, also without elements."""
    from slowtime.finite_elements.assembly import _scattered, element_matrices

    size = 6 * len(frame.node_names)
    return _scattered(element_matrices(frame), size, "stiffness", None).toarray()


def test_constraints_join_shells_to_other_nodes():
    frame = plate(2, 2, thickness=0.01)
    tie = MultiPointConstraint(terms=(("2.2", "uz", 1.0), ("2.0", "uz", -1.0)))
    model = assemble(dataclasses.replace(frame, constraints=(tie,)))
    assert model.size == 6 * 9 - 1


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (
            [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]],
            r"Shell number 1 is not flat.*smaller",
        ),
        ([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], r"no area|not convex"),
        ([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]], r"Shell number 1 is not convex"),
        ([[0, 0, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0]], r"two corners at one place"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], r"has no area"),
    ],
)
def test_shells_that_are_none_are_refused(corners, message):
    shell = Shell(name="s", corners=("a", "b", "c", "d"), thickness_m=0.1, material=STEEL)
    frame = Frame(
        node_names=("a", "b", "c", "d"), coordinates=np.array(corners, float), shells=(shell,)
    )
    with pytest.raises(ValueError, match=message):
        assemble(frame)
