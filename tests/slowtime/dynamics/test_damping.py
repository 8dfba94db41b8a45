import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from slowtime.dynamics.builders import chain
from slowtime.dynamics.damping import (
    caughey,
    fit_damping_ratio,
    generalised_proportional,
    is_proportional,
    modal_damping,
    non_proportionality,
    rayleigh,
    rayleigh_coefficients,
    smooth_damping,
)
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import complex_modes, undamped_modes
from slowtime.dynamics.structure import Structure

BARE = assemble(chain([1.0, 2.0, 1.5, 1.0], [800.0, 600.0, 700.0, 500.0]))
M, K = BARE.mass, BARE.stiffness
OMEGA = undamped_modes(BARE).angular_frequency


def ratios(damping):
    """Damping ratios of modes that really are uncoupled, by the state space."""
    structure = Structure(mass=M, damping=damping, stiffness=K)
    assert is_proportional(structure)
    a = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(M, np.hstack([K, damping]))]]
    )
    poles = np.linalg.eigvals(a)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    np.testing.assert_allclose(np.abs(poles), OMEGA, rtol=1e-10)
    return -poles.real / np.abs(poles)


def test_rayleigh_gives_its_two_modes_their_ratios_and_the_others_the_law():
    a0, a1 = rayleigh_coefficients((OMEGA[0], OMEGA[2]), (0.02, 0.03))
    found = ratios(rayleigh(M, K, a0, a1))
    np.testing.assert_allclose(found[[0, 2]], [0.02, 0.03], rtol=1e-10)
    np.testing.assert_allclose(found, (a0 / OMEGA + a1 * OMEGA) / 2, rtol=1e-10)


def test_a_ratio_for_each_mode_is_what_each_mode_gets():
    given_ratios = np.array([0.01, 0.05, 0.02, 0.08])
    np.testing.assert_allclose(ratios(modal_damping(M, K, given_ratios)), given_ratios)
    np.testing.assert_allclose(ratios(modal_damping(M, K, 0.03)), 0.03)


def test_caughey_is_exact_through_its_ratios_and_is_the_series_it_says():
    given_ratios = np.array([0.02, 0.025, 0.03])
    damping, c = caughey(M, K, given_ratios)
    found = ratios(damping)
    np.testing.assert_allclose(found[:3], given_ratios, rtol=1e-9)
    step = np.linalg.solve(M, K)
    series = sum(c[j] * M @ np.linalg.matrix_power(step, j) for j in range(3))
    np.testing.assert_allclose(damping, series, atol=1e-9)
    powers = 2 * np.arange(3) - 1
    np.testing.assert_allclose(found, 0.5 * (OMEGA[:, None] ** powers) @ c, rtol=1e-9)


def test_two_terms_of_caughey_are_rayleigh():
    damping, c = caughey(M, K, np.array([0.02, 0.03]))
    a0, a1 = rayleigh_coefficients((OMEGA[0], OMEGA[1]), (0.02, 0.03))
    np.testing.assert_allclose(c, [a0, a1], rtol=1e-10)
    np.testing.assert_allclose(damping, rayleigh(M, K, a0, a1), rtol=1e-10, atol=1e-12)


def test_a_series_that_feeds_energy_into_a_mode_is_refused():
    with pytest.raises(ValueError, match=r"gives mode \d a damping ratio of -.*stays positive"):
        caughey(M, K, np.array([0.05, 0.08, 0.02]))


def test_generalised_damping_is_the_function_of_the_matrix():
    def f1(x):
        return 0.1 * np.exp(-x / 400) + 0.02 * np.sqrt(x)

    def f2(y):
        return 1e-3 * np.cos(40 * y)

    damping = generalised_proportional(M, K, f1, f2)
    of_m = scipy.linalg.solve(M, K)
    of_k = scipy.linalg.solve(K, M)
    truth = M @ (0.1 * scipy.linalg.expm(-of_m / 400) + 0.02 * scipy.linalg.sqrtm(of_m)) + K @ (
        1e-3 * scipy.linalg.cosm(40 * of_k)
    )
    np.testing.assert_allclose(damping, truth, atol=1e-10)
    expected = (f1(OMEGA**2) + OMEGA**2 * f2(1 / OMEGA**2)) / (2 * OMEGA)
    np.testing.assert_allclose(ratios(damping), expected, rtol=1e-8)


def test_smooth_damping_is_2_m_s_zeta_of_s():
    damping = smooth_damping(M, K, lambda w: 0.02 + 1e-4 * w**2)
    root = scipy.linalg.sqrtm(scipy.linalg.solve(M, K))
    truth = 2 * M @ root @ (0.02 * np.eye(4) + 1e-4 * root @ root)
    np.testing.assert_allclose(damping, truth, atol=1e-10)
    np.testing.assert_allclose(ratios(damping), 0.02 + 1e-4 * OMEGA**2, rtol=1e-8)


@given(
    a=st.floats(0.0, 1.0),
    b=st.floats(0.0, 0.1),
    c=st.floats(0.0, 1e-3),
    scale=st.floats(0.1, 1e3),
)
def test_a_law_of_the_fitted_form_is_found_again_whatever_the_unit(a, b, c, scale):
    w = scale * np.array([3.0, 10.0, 20.0, 50.0])
    law = fit_damping_ratio(w, a * scale / w + b + c * w / scale)
    np.testing.assert_allclose(law(w), a * scale / w + b + c * w / scale, atol=1e-9)


def test_a_fitted_ratio_is_positive_at_every_frequency_whatever_was_measured():
    law = fit_damping_ratio(np.array([3.0, 10.0, 20.0]), np.array([0.05, 0.001, 0.08]))
    assert np.all(law.coefficients >= 0)
    assert np.all(law(np.geomspace(1e-3, 1e5, 50)) > 0)


def test_a_fit_weighs_by_its_errors_and_says_how_well_they_explain_it():
    rng = np.random.default_rng(3)
    w, sd = np.linspace(2.0, 60.0, 200), np.full(200, 0.002)
    truth = 0.1 / w + 0.01 + 2e-4 * w
    law = fit_damping_ratio(w, truth + sd * rng.standard_normal(200), sd)
    assert law.reduced_chi2 == pytest.approx(1.0, abs=0.25)
    np.testing.assert_allclose(law(w), truth, atol=1e-3)
    wild = truth.copy()
    wild[::2] += 0.5
    heavy = np.where(np.arange(200) % 2 == 0, 1e3, 0.002)
    np.testing.assert_allclose(fit_damping_ratio(w, wild, heavy)(w), truth, atol=1e-6)


def test_example_3_3_has_real_modes_and_example_3_5_has_not(family):
    assert non_proportionality(family["example 3.3"]()) < 1e-15
    structure = family["example 3.5"]()
    # Eq. 3.248 and 3.249, c k / m = 0.2: their difference over the larger of them.
    assert non_proportionality(structure) == pytest.approx(0.2 / 0.4)
    assert not is_proportional(structure)
    assert np.abs(complex_modes(structure).shapes.imag).max() > 1e-2


def test_modes_are_uncoupled_exactly_where_the_test_says_so(structure):
    x = undamped_modes(structure).shapes
    modal = x.T @ structure.damping @ x
    coupling = np.abs(modal - np.diag(np.diag(modal))).max()
    if is_proportional(structure):
        assert coupling <= 1e-8 * max(np.abs(modal).max(), 1e-300)
    else:
        assert coupling > 1e-4 * np.abs(modal).max()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rayleigh_coefficients((1.0, 1.0), (0.1, 0.1)), "two different frequencies"),
        (lambda: caughey(M, K, np.full(5, 0.01)), "one to as many"),
        (lambda: fit_damping_ratio(np.array([0.0]), np.array([0.1])), "not above 0"),
        (
            lambda: smooth_damping(np.eye(1), np.zeros((1, 1)), lambda w: w),
            "rigid-body mode",
        ),
    ],
)
def test_damping_that_cannot_be_made_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
