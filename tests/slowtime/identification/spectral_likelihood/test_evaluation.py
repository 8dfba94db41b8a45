import numpy as np
import pytest

from slowtime.identification.spectral_likelihood.evaluation import (
    band_log_likelihood,
    inverse_density,
)
from slowtime.identification.spectral_likelihood.model import BandData


def positive(size, groups=40, seed=1):
    rng = np.random.default_rng(seed)
    shape = (groups, size, size + 2)
    y = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    return y @ y.conj().transpose(0, 2, 1)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_inverses_and_determinants_are_those_of_lapack(size):
    given = positive(size)
    inverse, logarithm = inverse_density(given)
    assert inverse is not None
    np.testing.assert_allclose(inverse, np.linalg.inv(given), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(logarithm, np.linalg.slogdet(given)[1], rtol=1e-10)


def test_one_matrix_that_is_not_positive_definite_has_no_likelihood():
    given = positive(3)
    data = BandData(np.arange(40.0), given, np.full(40, 2.0))
    assert np.isfinite(band_log_likelihood(data, given))
    given = given.copy()
    given[17] -= 1.01 * np.linalg.eigvalsh(given[17])[0] * np.eye(3)
    assert inverse_density(given)[0] is None
    assert band_log_likelihood(data, given) == -np.inf
    given[17, 1, 1] = np.nan
    assert band_log_likelihood(data, given) == -np.inf


def test_the_likelihood_is_that_of_whittle():
    density, seen = positive(3), positive(3, seed=2)
    number = np.linspace(1.0, 4.0, 40)
    data = BandData(np.arange(40.0), seen, number)
    trace = np.trace(np.linalg.solve(density, seen), axis1=1, axis2=2).real
    expected = -np.sum(number * (np.linalg.slogdet(density)[1] + trace))
    assert band_log_likelihood(data, density) == pytest.approx(expected, rel=1e-12)
