"""Motion in closed form against exact tables, the matrix exponential and the printed forms."""

import csv

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.closed_form_motion import free_motion, pulse_motion, step_motion
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.structure import state_matrix
from slowtime.dynamics.transfer import laplace_response

E2, E23 = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 1.0])
TIMES = np.linspace(0.0, 20.0, 41)
# From the table of responses (ODE and matrix exponential agree to 7e-13), at 1, 5 and 20 s.
TABLE = {
    ("example 3.3", "q0"): [
        [0.33110204264518817, 0.2704007233563429, 0.3311020426451883],
        [0.020329408336809966, -0.5592322321723827, 0.020329408336810427],
        [-0.06958614210511355, -0.009187459133015724, -0.06958614210511359],
    ],
    ("example 3.5", "v0"): [
        [0.13620069254905448, 0.8418620918287982, 0.7694176808272547],
        [-0.551833068548293, -0.5313585037741062, -0.2524676409347666],
        [0.13817066538657125, 0.11980116912319705, 0.14400594965763613],
    ],
}


def by_exponential(structure, times, displacement, velocity):
    a = state_matrix(structure)
    x0 = np.concatenate([displacement, velocity])
    states = np.array([scipy.linalg.expm(a * t) @ x0 for t in times])
    return states[:, : structure.dofs], states[:, structure.dofs :]


@pytest.mark.parametrize(("name", "what"), TABLE)
def test_the_examples_move_as_the_exact_table_says(family, name, what):
    start = (E2, 0 * E2) if what == "q0" else (0 * E2, E23)
    found, _ = free_motion(family[name](), np.array([1.0, 5.0, 20.0]), *start)
    np.testing.assert_allclose(found, TABLE[name, what], atol=2e-12)


def test_every_row_of_the_table_of_responses_is_reproduced(tables, family):
    starts = {"q0=e2": (E2, 0 * E2), "v0=e2+e3": (0 * E2, E23)}
    with (tables / "T8_mdof_responses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 20
    for row in rows:
        structure = family[row["system"].replace("ex", "example ")]()
        found, _ = free_motion(structure, np.array([float(row["t"])]), *starts[row["initial"]])
        np.testing.assert_allclose(
            found[0], [float(row[f"q{k}"]) for k in (1, 2, 3)], atol=2e-12
        )


def test_free_motion_is_the_matrix_exponential(any_structure):
    rng = np.random.default_rng(5)
    q0, v0 = rng.standard_normal((2, any_structure.dofs))
    times = TIMES / 20.0
    q, v = free_motion(any_structure, times, q0, v0)
    truth = by_exponential(any_structure, times, q0, v0)
    np.testing.assert_allclose(q, truth[0], atol=2e-9 * np.abs(truth[0]).max())
    np.testing.assert_allclose(v, truth[1], atol=2e-9 * np.abs(truth[1]).max())
    np.testing.assert_allclose(q[0], q0, atol=1e-12)
    np.testing.assert_allclose(v[0], v0, atol=1e-10 * np.abs(v).max())


def test_3_194_needs_its_sine(family):
    """Initial displacement of the second mass: right with the term that the print lacks."""
    structure, m = family["example 3.3"](), 1.0
    modes = undamped_modes(structure)
    x, w = modes.shapes, modes.angular_frequency
    z = 0.1 / w
    wd, t = w * np.sqrt(1 - z**2), TIMES[:, None]
    found, _ = free_motion(structure, TIMES, E2, 0 * E2)
    whole = np.cos(wd * t) + z * w / wd * np.sin(wd * t)
    right = (x[1] * m * np.exp(-z * w * t) * whole) @ x.T
    printed = (x[1] * m * np.exp(-z * w * t) * np.cos(wd * t)) @ x.T
    np.testing.assert_allclose(found, right, atol=1e-13)
    assert np.abs(found - printed).max() > 0.06


def test_3_197_is_right_as_printed(family):
    structure = family["example 3.3"]()
    modes = undamped_modes(structure)
    x, w = modes.shapes, modes.angular_frequency
    wd, t = np.sqrt(w**2 - 0.01), TIMES[:, None]
    printed = ((x[1] + x[2]) / wd * np.exp(-0.1 * t) * np.sin(wd * t)) @ x.T
    np.testing.assert_allclose(
        free_motion(structure, TIMES, 0 * E2, E23)[0], printed, atol=1e-13
    )


def test_3_186_to_3_188_hold_after_the_pulse(family):
    structure, t0 = family["example 3.3"](), 3.0
    modes = undamped_modes(structure)
    x, w = modes.shapes, modes.angular_frequency
    z = 0.1 / w
    wd, grown = w * np.sqrt(1 - z**2), np.exp(z * w * t0)
    t = TIMES[TIMES > t0]
    alpha = (wd * np.sin(wd * t0) + z * w * np.cos(wd * t0)) * grown - z * w
    beta = (wd * np.cos(wd * t0) - z * w * np.sin(wd * t0)) * grown - wd
    wave = alpha * np.sin(np.outer(t, wd)) + beta * np.cos(np.outer(t, wd))
    printed = (x[0] * np.exp(-np.outer(t, z * w)) / (wd * w**2) * wave) @ x.T
    found, _ = pulse_motion(structure, t, np.array([1.0, 0.0, 0.0]), t0)
    np.testing.assert_allclose(found, printed, atol=1e-13)


@pytest.mark.parametrize("name", ["example 3.3", "example 3.5", "partly overdamped", "beam"])
def test_a_pulse_is_the_integral_of_the_equation_of_motion(family, name):
    structure = family[name]()
    force = np.zeros(structure.dofs)
    force[-1] = 2.0
    times, t0 = np.linspace(0.0, 3.0, 31), 1.1
    # Force as a constant state beside the motion: one exponential while it acts, one after.
    a = np.zeros((2 * structure.dofs + 1,) * 2)
    a[:-1, :-1] = state_matrix(structure)
    a[structure.dofs : -1, -1] = np.linalg.solve(structure.mass, force)
    rest = np.zeros(2 * structure.dofs + 1)
    rest[-1] = 1.0
    end = scipy.linalg.expm(a * t0) @ rest
    end[-1] = 0.0
    truth = np.array(
        [
            scipy.linalg.expm(a * t) @ rest
            if t <= t0
            else scipy.linalg.expm(a * (t - t0)) @ end
            for t in times
        ]
    )
    q, v = pulse_motion(structure, times, force, t0)
    np.testing.assert_allclose(q, truth[:, : structure.dofs], atol=1e-10)
    np.testing.assert_allclose(v, truth[:, structure.dofs : -1], atol=1e-9)


def test_a_step_ends_at_rest_where_the_springs_balance_it(family):
    structure, force = family["random dampers"](), np.arange(6.0)
    q, v = step_motion(structure, np.array([0.0, 400.0]), force)
    np.testing.assert_allclose(structure.stiffness @ q[1], force, atol=1e-8)
    np.testing.assert_allclose(v[1], 0.0, atol=1e-8)
    np.testing.assert_allclose(q[0], 0.0, atol=1e-12)


def test_time_and_laplace_domain_are_one_response(family):
    structure = family["example 3.5"]()
    times = np.linspace(0.0, 60.0, 60_001)
    q, _ = free_motion(structure, times, E2, E23)
    s = np.array([0.4 + 0.0j, 0.5 + 1.3j])
    numeric = np.array(
        [np.trapezoid(q * np.exp(-point * times)[:, None], times, axis=0) for point in s]
    )
    found = laplace_response(structure, s, displacement=E2, velocity=E23)
    np.testing.assert_allclose(found, numeric, atol=1e-6)


def test_energy_of_an_undamped_structure_stays(family):
    structure = family["undamped"]()
    rng = np.random.default_rng(0)
    q, v = free_motion(structure, np.linspace(0, 500.0, 99), *rng.standard_normal((2, 5)))
    energy = np.einsum("ta,ab,tb->t", v, structure.mass, v) + np.einsum(
        "ta,ab,tb->t", q, structure.stiffness, q
    )
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)


def test_what_cannot_be_answered_is_refused(family):
    with pytest.raises(ValueError, match="before the release"):
        free_motion(family["example 3.3"](), np.array([-1.0]), E2, E2)
    with pytest.raises(ValueError, match="free to drift"):
        step_motion(family["free to drift"](), np.array([1.0]), np.ones(2))
