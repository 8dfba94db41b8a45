import numpy as np
import pytest

from slowtime.identification.free_decay.decay_fit import (
    _waves,
    drift_basis,
    fit_decays,
    matrix_pencil,
    signal_subspace,
)

RATE = 200.0
TIMES = np.arange(800) / RATE
POLES = np.array([-0.8 + 62.0j, -1.5 + 75.0j])
AMPLITUDES = np.array([1.0 + 0.5j, -0.3 + 0.2j])
SERIES = np.real(np.exp(np.multiply.outer(TIMES, POLES)) @ AMPLITUDES)


def test_the_matrix_pencil_finds_the_poles_of_clean_decays():
    found = matrix_pencil(signal_subspace(SERIES), RATE, 2)
    np.testing.assert_allclose(sorted(found, key=np.imag), POLES, rtol=1e-5)


def test_clean_decays_on_drift_are_recovered_with_their_amplitudes():
    drift = drift_basis(len(TIMES), 3)
    series = SERIES + drift @ np.array([50.0, -20.0, 9.0])
    fit = fit_decays(series, RATE, POLES * 1.004 - 0.1, drift)
    order = np.argsort(fit.poles.imag)
    np.testing.assert_allclose(fit.poles[order], POLES, rtol=1e-6)
    np.testing.assert_allclose(fit.amplitudes[order], AMPLITUDES, rtol=1e-5)
    assert fit.converged


def test_the_fit_is_where_a_general_optimiser_ends_too():
    from scipy.optimize import least_squares

    rng = np.random.default_rng(1)
    noisy = SERIES + 0.1 * rng.standard_normal(len(TIMES))
    fit = fit_decays(noisy, RATE, POLES, drift_basis(len(TIMES), 1))

    def residual(p):
        waves = np.exp(np.multiply.outer(TIMES, p[:2] + 1j * p[2:4]))
        return np.real(waves @ (p[4:6] + 1j * p[6:8])) + p[8] - noisy

    start = [*POLES.real, *POLES.imag, *AMPLITUDES.real, *AMPLITUDES.imag, 0.0]
    other = least_squares(residual, start, x_scale=np.maximum(np.abs(start), 0.1), xtol=1e-12)
    assert fit.cost == pytest.approx(2 * other.cost, rel=1e-6)
    np.testing.assert_allclose(fit.poles, other.x[:2] + 1j * other.x[2:4], atol=2e-3)
    slopes = np.asarray(other.jac)
    covariance = np.linalg.inv(slopes.T @ slopes)[:4, :4]
    np.testing.assert_allclose(fit.unit_covariance, covariance, rtol=2e-2, atol=2e-4)


def test_poles_that_coincide_do_not_break_the_fit():
    fit = fit_decays(SERIES, RATE, np.array([POLES[0], POLES[0]]), drift_basis(len(TIMES), 1))
    assert np.isfinite(fit.cost)
    assert fit.cost <= SERIES @ SERIES


def test_no_step_leaves_the_amplitudes_alone_to_be_solved():
    drift = drift_basis(len(TIMES), 1)
    fit = fit_decays(SERIES, RATE, POLES, drift, steps=0)
    np.testing.assert_array_equal(fit.poles, POLES)
    # The drift takes the mean of the series, and the fit knows.
    assert fit.cost < 1e-18 * (SERIES @ SERIES)


def test_drift_columns_are_orthonormal():
    basis = drift_basis(300, 7)
    np.testing.assert_allclose(basis.T @ basis, np.eye(7), atol=1e-12)


@pytest.mark.parametrize("count", [1, 31, 32, 33, 1000])
def test_exponentials_by_blocks_are_those_of_each_time(count):
    times = np.arange(count) / 37.0
    poles = np.array([-0.4 + 20j, 0.02 + 3j])
    exact = np.exp(np.multiply.outer(times, poles))
    assert _waves(times, poles) == pytest.approx(exact, rel=1e-13)
