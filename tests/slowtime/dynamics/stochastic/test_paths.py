import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.dynamics.builders import chain
from slowtime.dynamics.stochastic import Springs, WhiteForce, kernel, simulate

EFFECTS = (
    {"effect": "cubic_hardening", "element": "k1", "k3_n_per_m3": 900.0},
    {"effect": "van_der_pol", "element": "k2", "cn_n_s_per_m": 3.0, "e0_m": 0.4},
    {"effect": "quadratic_damping", "element": "k2", "c2_n_s2_per_m2": 2.0},
)


def pair(effects=EFFECTS):
    plain = chain([2.0, 1.0], [100.0, 50.0], dampings_n_s_per_m=[1.0, 0.5])
    return Springs.of(dataclasses.replace(plain, effects=effects))


def by_hand(t, y, force=(0.0, 0.0)):
    x, v = y[:2], y[2:]
    e, w = np.array([x[0], x[1] - x[0]]), np.array([v[0], v[1] - v[0]])
    pull = np.array([100.0, 50.0]) * e + np.array([1.0, 0.5]) * w
    pull[0] += 900.0 * e[0] ** 3
    pull[1] += 3.0 * ((e[1] / 0.4) ** 2 - 1.0) * w[1] + 2.0 * abs(w[1]) * w[1]
    return np.array(
        [*v, (force[0] - pull[0] + pull[1]) / 2.0, (force[1] - pull[1]) / 1.0], dtype=float
    )


START = np.array([0.3, -0.2, 1.0, 0.5])


@pytest.mark.long
def test_without_noise_the_motion_is_that_of_a_fine_integrator():
    springs = pair()
    forces = np.zeros((2501, 1, 2))
    forces[:, 0, 0] = 3.0 * np.linspace(0, 1, 2501)
    exact = solve_ivp(
        lambda t, y: by_hand(t, y, (3.0 * t / 2.5, 0.0)),
        (0, 2.5), START, rtol=1e-11, atol=1e-12, t_eval=np.linspace(0, 2.5, 2501),
    ).y.T  # fmt: skip
    still = WhiteForce(added=np.zeros(2))
    path = simulate(springs, forces, 1000.0, still, np.random.default_rng(0), start=START[None])
    np.testing.assert_allclose(path[:, 0], exact, atol=5e-4)
    state = START[None]
    for k in range(0, 2500, 5):
        state = springs.move(state, forces[k], forces[k + 5], 0.005)
    # Drag has a corner in its second derivative, which costs the last digits.
    np.testing.assert_allclose(state[0], exact[-1], atol=1e-6)


def coarser(dw, dz, h):
    """Two steps of Brownian increments as one."""
    joined = dw[0::2] + dw[1::2]
    return joined, dz[0::2] + dz[1::2] + h * dw[0::2]


def end_of(springs, dw, dz, h, noise, start):
    paths = dw.shape[1]
    state, room = np.repeat(start[None], paths, axis=0), kernel.room_for(2)
    rows, force = springs.rows(None, paths), np.zeros((1, 2))
    for k in range(len(dw)):
        one = dw[k] / np.sqrt(h)
        two = np.sqrt(3.0) * (2.0 * dz[k] / h**1.5 - one)
        kernel.ito_taylor(
            springs.ends, springs.laws, rows, state, force, force, 0.0, h,
            noise.added, noise.per_metre, np.stack([one, two]), room,
        )  # fmt: skip
    return state


@pytest.mark.parametrize("kind", ["multiplied", "added"])
def test_paths_converge_with_the_step_to_the_power_one_and_a_half_or_better(kind):
    springs = pair(EFFECTS[:2])
    own = np.array([1.5, 1.0])
    noise = (
        WhiteForce(added=own)
        if kind == "added"
        else WhiteForce(added=0.0 * own, multiplied=3.0 * own)
    )
    rng = np.random.default_rng(31)
    h, steps, paths = 1.0 / 1024, 1024, 60
    one, two = rng.standard_normal((2, steps, paths, 2))
    dw, dz = np.sqrt(h) * one, 0.5 * h**1.5 * (one + two / np.sqrt(3))
    exact = end_of(springs, dw, dz, h, noise, START)
    errors = []
    for _ in range(5):
        dw, dz = coarser(dw, dz, h)
        h *= 2
        if h >= 1.0 / 256:
            found = end_of(springs, dw, dz, h, noise, START)
            errors.append(np.sqrt(np.mean((found - exact) ** 2)))
    order = np.log2(errors[-1] / errors[0]) / (len(errors) - 1)
    assert order > 1.4


def test_a_linear_oscillator_settles_at_the_variance_that_theory_gives():
    plain = Springs.of(chain([2.0], [50.0], dampings_n_s_per_m=[4.0]))
    sigma = 3.0
    path = simulate(
        plain, np.zeros((1201, 1, 1)), 200.0, WhiteForce(added=np.array([sigma])),
        np.random.default_rng(32), start=np.zeros((1500, 2)),
    )  # fmt: skip
    last = path[-1]
    assert last[:, 0].var() == pytest.approx(sigma**2 / (2 * 4.0 * 50.0), rel=0.12)
    assert last[:, 1].var() == pytest.approx(sigma**2 / (2 * 4.0 * 2.0), rel=0.12)


def test_the_same_seed_gives_the_same_paths_and_nothing_given_is_changed():
    springs, start = pair(), np.repeat(START[None], 3, axis=0)
    forces, white = np.zeros((20, 1, 2)), WhiteForce(added=np.ones(2))
    kept = start.copy()
    a, b = (
        simulate(springs, forces, 100.0, white, np.random.default_rng(5), start=start)
        for _ in range(2)
    )
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(start, kept)
    np.testing.assert_array_equal(a[0], start)
    assert np.std(a[-1, :, 0]) > 0


def test_rows_of_parameters_and_forces_go_with_their_paths():
    springs = pair()
    values = np.repeat(springs.values[None], 4, axis=0)
    values[2:, 0] *= 1.3
    forces = np.zeros((11, 2, 2))
    forces[:, 1, 0] = 5.0
    white = WhiteForce(added=np.zeros(2))
    path = simulate(
        springs, forces, 100.0, white, np.random.default_rng(6),
        values=values, start=np.repeat(START[None], 4, axis=0),
    )  # fmt: skip
    np.testing.assert_array_equal(path[:, 0], path[:, 1])
    np.testing.assert_array_equal(path[:, 2], path[:, 3])
    assert np.abs(path[-1, 0] - path[-1, 2]).max() > 1e-4


@pytest.mark.parametrize(
    ("effect", "cure"),
    [
        (
            {"effect": "coulomb", "element": "k1", "friction_n": 1.0},
            "cubic_hardening, van_der_pol",
        ),
    ],
)
def test_laws_with_memory_are_refused(effect, cure):
    with pytest.raises(ValueError, match=cure):
        pair((effect,))


def test_wrong_shapes_are_refused_with_the_cure():
    springs, rng = pair(), np.random.default_rng(7)
    white = WhiteForce(added=np.zeros(2))
    with pytest.raises(ValueError, match="a force on each"):
        simulate(springs, np.zeros((5, 1, 2)), 10.0, white, rng, start=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="one for all"):
        simulate(springs, np.zeros((5, 2, 2)), 10.0, white, rng, start=np.zeros((3, 4)))
    with pytest.raises(ValueError, match="No parameter is called"):
        springs.where([("stiffness", "k9")])
