import numpy as np
import pytest

from slowtime.surrogate import homotopy
from slowtime.surrogate.bases import indices, products
from slowtime.surrogate.problems import PROBLEMS


def kkt(design, outputs, weights):
    """Least weight under the equations themselves, with multipliers."""
    points, terms = design.shape
    system = np.block([[np.diag(weights), design.T], [design, np.zeros((points, points))]])
    return np.linalg.solve(system, np.concatenate([np.zeros(terms), outputs]))[:terms]


def published(design, outputs, weights):
    """As Li and Rabitz write it, with the projector and its singular vectors."""
    pseudo = np.linalg.pinv(design)
    projector = np.eye(design.shape[1]) - pseudo @ design
    u, s, vt = np.linalg.svd(projector @ np.diag(weights))
    rank = int(np.sum(s > 1e-10 * s[0]))
    u, v = u[:, rank:], vt[rank:].T
    return v @ np.linalg.solve(u.T @ v, u.T @ (pseudo @ outputs))


def expansion(points=60, degree=8):
    problem = PROBLEMS["Ishigami"]
    x, y = problem.design(points, np.random.default_rng(3))
    terms = indices(3, degree)
    together = np.sum(terms > 0, axis=1)
    weights = (1.0 + terms.sum(axis=1)) ** 2 * 4.0 ** np.maximum(together - 1, 0)
    return products(x, problem.marginals, terms), y, weights.astype(float)


@pytest.mark.parametrize("seed", range(20))
def test_weights_of_any_system_are_those_of_the_kkt_equations(seed):
    rng = np.random.default_rng(seed)
    points, terms = int(rng.integers(5, 40)), int(rng.integers(41, 120))
    design = rng.standard_normal((points, terms))
    outputs = rng.standard_normal(points)
    weights = np.exp(rng.normal(0.0, 1.5, terms))
    found = homotopy(design, outputs, weights)
    np.testing.assert_allclose(found, kkt(design, outputs, weights), rtol=0, atol=1e-10)


def test_weights_of_an_expansion_are_those_of_kkt_and_of_the_published_projection():
    design, outputs, weights = expansion()
    assert design.shape == (60, 165)
    found = homotopy(design, outputs, weights)
    np.testing.assert_allclose(found, kkt(design, outputs, weights), rtol=0, atol=1e-10)
    np.testing.assert_allclose(found, published(design, outputs, weights), rtol=0, atol=1e-9)
    np.testing.assert_allclose(design @ found, outputs, atol=1e-10)


def test_with_points_enough_it_is_least_squares_whatever_the_weights():
    design, outputs, weights = expansion(points=300, degree=5)
    expected = np.linalg.lstsq(design, outputs)[0]
    np.testing.assert_allclose(homotopy(design, outputs, weights), expected, atol=1e-10)


def test_nothing_that_fits_weighs_less():
    design, outputs, weights = expansion()
    found = homotopy(design, outputs, weights)
    _, _, vt = np.linalg.svd(design)
    for free in vt[60:65]:
        assert weights @ (found + 0.01 * free) ** 2 > weights @ found**2


def test_weights_of_nought_are_refused():
    with pytest.raises(ValueError, match=r"Weights go from 0 to 1\. Give positive"):
        homotopy(np.ones((1, 2)), np.ones(1), np.array([0.0, 1.0]))
