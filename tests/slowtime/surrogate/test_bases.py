import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad_vec

from slowtime.surrogate.bases import indices, polynomials, products

LAWS = [
    stats.uniform(-2.0, 5.0),
    stats.norm(3.0, 0.7),
    stats.expon(scale=2.0),
    stats.beta(2.0, 5.0),
    stats.gumbel_r(1.0, 0.3),
    stats.triang(0.3),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.dist.name)
def test_polynomials_are_orthonormal_under_their_law(law):
    degree = 5

    def outer(x):
        row = polynomials(np.array([x]), law, degree)[0]
        return np.outer(row, row) * law.pdf(x)

    lo, hi = law.ppf(1e-18), law.isf(1e-18)
    gram, _ = quad_vec(outer, lo, hi, points=law.ppf([0.01, 0.3, 0.99]), epsabs=1e-9)
    np.testing.assert_allclose(gram, np.eye(degree + 1), atol=1e-5)


def test_legendre_and_hermite_are_those_of_numpy():
    x = np.linspace(-0.9, 0.9, 7)
    ours = polynomials(x, stats.uniform(-1.0, 2.0), 6)[:, 6]
    np.testing.assert_allclose(ours, np.polynomial.Legendre.basis(6)(x) * np.sqrt(13.0))
    ours = polynomials(x, stats.norm(), 4)[:, 4]
    np.testing.assert_allclose(ours, np.polynomial.HermiteE.basis(4)(x) / np.sqrt(24.0))


def test_there_are_as_many_terms_as_there_should_be():
    assert len(indices(3, 4)) == 35
    assert len(indices(10, 3, interaction=2)) == 1 + 10 * 3 + 45 * 3
    assert {tuple(row) for row in indices(2, 3, q_norm=0.5)} == {
        (0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (0, 2), (0, 3)
    }  # fmt: skip


def test_a_product_is_a_product():
    laws = LAWS[:2]
    x = np.array([[0.5, 2.0], [1.0, 3.5]])
    terms = np.array([[2, 3]])
    expected = polynomials(x[:, 0], laws[0], 2)[:, 2] * polynomials(x[:, 1], laws[1], 3)[:, 3]
    np.testing.assert_allclose(products(x, laws, terms)[:, 0], expected)


def test_too_many_terms_and_laws_without_moments_are_refused():
    with pytest.raises(ValueError, match=r"more than 12000 terms.*Lower degree"):
        indices(10, 7)
    with pytest.raises(ValueError, match=r"q_norm=1.5 is outside"):
        indices(2, 2, q_norm=1.5)
    with pytest.raises(ValueError, match=r"leaves a constant only"):
        indices(2, 0)
