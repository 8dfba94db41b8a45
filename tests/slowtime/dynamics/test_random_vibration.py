import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import quad_vec

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import assemble
from slowtime.dynamics.random_vibration import (
    Shaping,
    growing_covariance,
    kanai_tajimi,
    low_pass,
    response_correlation,
    response_covariance,
    response_spectrum,
)
from slowtime.dynamics.simulation import ambient_structure, simulate_structure
from slowtime.dynamics.structure import Structure

STRUCTURE = assemble(chain([2.0, 1.0], [300.0, 200.0], dampings_n_s_per_m=[3.0, 0.5]))
PSD = np.array([[2.0, 0.6], [0.6, 1.0]])
COLOURS = {"low pass": low_pass(1.5), "Kanai-Tajimi": kanai_tajimi(2.5, 0.4)}


def integrated(quantity, shaping=None):
    def density(f):
        one = response_spectrum(STRUCTURE, np.array([f]), PSD, quantity, shaping=shaping)
        return one[0].real

    total = sum(
        quad_vec(density, low, high, epsabs=1e-13, epsrel=1e-10)[0]
        for low, high in ((0, 1.2), (1.2, 2.0), (2.0, 4.0), (4.0, 20.0), (20.0, 5000.0))
    )
    return np.asarray(total)


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
@pytest.mark.parametrize("colour", [None, *COLOURS])
def test_covariance_is_the_integral_of_the_spectrum(quantity, colour):
    shaping = None if colour is None else COLOURS[colour]
    covariance = getattr(response_covariance(STRUCTURE, PSD, shaping=shaping), quantity)
    # Beyond 5 kHz a white-force velocity density falls as 1/f^2 and leaves 1e-5 of the whole.
    np.testing.assert_allclose(integrated(quantity, shaping), covariance, rtol=2e-4)


@pytest.mark.parametrize("colour", COLOURS)
def test_under_coloured_force_acceleration_has_a_covariance_too(colour):
    shaping = COLOURS[colour]
    found = response_covariance(STRUCTURE, PSD, shaping=shaping).acceleration
    assert found is not None
    np.testing.assert_allclose(integrated("acceleration", shaping), found, rtol=2e-3)
    assert response_covariance(STRUCTURE, PSD).acceleration is None


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


def test_a_colour_is_also_a_density_given_frequency_by_frequency():
    f, shaping = np.array([0.5, 2.0, 5.0]), COLOURS["low pass"]
    given = PSD * shaping.density(f)[:, None, None]
    np.testing.assert_allclose(
        response_spectrum(STRUCTURE, f, given),
        response_spectrum(STRUCTURE, f, PSD, shaping=shaping),
    )


def test_spectra_are_hermitian_and_have_no_negative_power(structure):
    f = np.array([0.1, 1.0, 3.0])
    spectrum = response_spectrum(structure, f, 1.0)
    np.testing.assert_allclose(spectrum, spectrum.conj().swapaxes(1, 2), rtol=1e-9)
    assert np.linalg.eigvalsh(spectrum).min() > -1e-9 * np.abs(spectrum).max()


def test_correlation_begins_with_the_covariance_and_is_the_transform_of_the_spectrum():
    lags = np.array([0.0, 0.13, 0.8])
    found = response_correlation(STRUCTURE, lags, PSD)
    np.testing.assert_allclose(found[0], response_covariance(STRUCTURE, PSD).displacement)

    def integrand(f):
        one = response_spectrum(STRUCTURE, np.array([f]), PSD)[0]
        return (one * np.exp(2j * np.pi * f * lags)[:, None, None]).real

    truth = sum(
        quad_vec(integrand, a, b, epsabs=1e-13, epsrel=1e-10)[0]
        for a, b in ((0, 1.2), (1.2, 2.0), (2.0, 4.0), (4.0, 300.0))
    )
    np.testing.assert_allclose(found, truth, atol=1e-6 * found[0].max())


def test_covariance_grows_from_rest_by_its_own_differential_equation():
    times = np.array([0.0, 0.05, 0.4, 40.0])
    found = growing_covariance(STRUCTURE, times, PSD)
    np.testing.assert_allclose(found[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(
        found[-1], response_covariance(STRUCTURE, PSD).displacement, rtol=1e-6
    )

    # By another road: the noise that came in at each earlier instant, moved on and added up.
    def arrived(u):
        h = impulse_matrix(u)
        return 0.5 * h @ PSD @ h.T

    for t, covariance in zip(times[1:3], found[1:3], strict=True):
        truth = quad_vec(arrived, 0.0, t, epsrel=1e-11)[0]
        np.testing.assert_allclose(covariance, truth, rtol=1e-8)


def impulse_matrix(u):
    m, c, k = STRUCTURE.mass, STRUCTURE.damping, STRUCTURE.stiffness
    inverse = np.linalg.inv(m)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ k, -inverse @ c]])
    return scipy.linalg.expm(a * u)[:2, 2:] @ inverse


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


@pytest.mark.parametrize("name", ["undamped", "free to drift", "driven"])
def test_motion_that_does_not_die_away_is_never_stationary(family, name):
    with pytest.raises(ValueError, match="never becomes stationary"):
        response_covariance(family[name](), 1.0)
