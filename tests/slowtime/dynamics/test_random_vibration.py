import numpy as np
import pytest

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import assemble
from slowtime.dynamics.random_vibration import (
    Shaping,
    kanai_tajimi,
    low_pass,
)
from slowtime.dynamics.simulation import ambient_structure, simulate_structure
from slowtime.dynamics.structure import Structure
from tests.slowtime.dynamics.random_vibration import response_covariance

STRUCTURE = assemble(chain([2.0, 1.0], [300.0, 200.0], dampings_n_s_per_m=[3.0, 0.5]))
PSD = np.array([[2.0, 0.6], [0.6, 1.0]])
COLOURS = {"low pass": low_pass(1.5), "Kanai-Tajimi": kanai_tajimi(2.5, 0.4)}


def test_one_degree_of_freedom_has_the_textbook_variances():
    m, c, k, s = 3.0, 0.7, 50.0, 4.0
    one = np.ones((1, 1))
    structure = Structure(mass=m * one, damping=c * one, stiffness=k * one)
    found = response_covariance(structure, s)
    assert found.displacement[0, 0] == pytest.approx(s / (4 * c * k))
    assert found.velocity[0, 0] == pytest.approx(s / (4 * c * m))
    assert found.displacement_velocity[0, 0] == pytest.approx(0.0, abs=1e-15)


def test_shaping_filters_have_the_densities_they_say():
    f = np.array([0.0, 0.7, 1.5, 2.5, 9.0])
    np.testing.assert_allclose(low_pass(1.5).density(f), 1 / (1 + (f / 1.5) ** 2))
    r, z = f / 2.5, 0.4
    law = (1 + (2 * z * r) ** 2) / ((1 - r**2) ** 2 + (2 * z * r) ** 2)
    np.testing.assert_allclose(kanai_tajimi(2.5, z).density(f), law)


def test_simulated_ambient_vibration_has_the_covariance_of_the_theory():
    rng = np.random.default_rng(3)
    q = ambient_structure(STRUCTURE, 60_000, 50.0, rng, force_psd=PSD, quantity="displacement")
    truth = response_covariance(STRUCTURE, PSD).displacement
    np.testing.assert_allclose(q.T @ q / len(q), truth, rtol=0.08)


def test_simulated_coloured_force_has_the_covariance_of_the_theory():
    rate, rng, shaping = 100.0, np.random.default_rng(6), COLOURS["low pass"]
    pole = shaping.state_matrix[0, 0]
    kept = np.exp(pole / rate)
    # The filter's own exact steps, in its stationary state from the start.
    variance = shaping.input_vector[0] ** 2 * 0.5 / (-2 * pole)
    steps = rng.standard_normal((120_000, 2)) * np.sqrt(variance * (1 - kept**2))
    steps[0] /= np.sqrt(1 - kept**2)
    force = np.empty_like(steps)
    state = np.zeros(2)
    for k, step in enumerate(steps):
        state = kept * state + step
        force[k] = state
    force = force @ np.linalg.cholesky(PSD).T
    q, _, a = simulate_structure(STRUCTURE, force, rate, hold="first")
    found = response_covariance(STRUCTURE, PSD, shaping=shaping)
    assert found.acceleration is not None
    late = slice(2000, None)
    np.testing.assert_allclose(np.cov(q[late].T), found.displacement, rtol=0.08)
    np.testing.assert_allclose(
        np.diag(np.cov(a[late].T)), np.diag(found.acceleration), rtol=0.08
    )


def test_a_filter_without_dynamics_of_its_own_is_white():
    fast = Shaping(np.array([[-1e5]]), np.array([1e5]), np.array([1.0]))
    found = response_covariance(STRUCTURE, PSD, shaping=fast)
    np.testing.assert_allclose(
        found.displacement, response_covariance(STRUCTURE, PSD).displacement, rtol=1e-3
    )
