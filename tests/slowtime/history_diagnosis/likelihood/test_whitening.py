import numpy as np
import pytest

from slowtime.estimation import filtering
from slowtime.estimation.matern import SlowProcess
from slowtime.history_diagnosis.likelihood.whitening import (
    MaternProcess,
    continue_whitening,
    whiten,
)
from tests.slowtime.estimation.matern_correlation import matern_correlation


def dense(process, time):
    apart = np.abs(np.subtract.outer(time, time)) / process.length
    return process.sd**2 * matern_correlation(process.smoothness, apart)


@pytest.fixture(params=[0.5, 1.5])
def process(request):
    return MaternProcess(request.param, 0.2, 0.7)


@pytest.fixture
def series(rng):
    time = np.sort(rng.uniform(0.0, 1.0, 60))
    time[10] = time[9]
    return time, rng.uniform(0.1, 0.5, 60), rng.standard_normal((60, 3))


def test_products_of_whitened_columns_are_those_of_the_dense_inverse(process, series):
    time, variance, columns = series
    filtered = whiten(process, time, variance, columns)
    covariance = dense(process, time) + np.diag(variance)
    np.testing.assert_allclose(
        filtered.white.T @ filtered.white,
        columns.T @ np.linalg.solve(covariance, columns),
        rtol=1e-9,
    )
    assert filtered.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1])


def test_the_likelihood_is_that_of_the_process_of_the_estimation_room(process, series):
    time, variance, columns = series
    filtered = whiten(process, time, variance, columns[:, :1])
    slow = SlowProcess(smoothness=process.smoothness, length=process.length, sd=process.sd)
    theirs = filtering.log_likelihood(slow, time, columns[:, 0], np.sqrt(variance))
    count = len(time) * np.log(2.0 * np.pi)
    ours = -0.5 * ((filtered.white**2).sum() + filtered.log_determinant + count)
    assert ours == pytest.approx(float(theirs))


def test_a_reading_of_infinite_variance_is_as_if_it_were_not_there(process, series):
    time, variance, columns = series
    without = np.arange(60) != 30
    masked = np.where(without, variance, np.inf)
    whole = whiten(process, time, masked, columns)
    part = whiten(process, time[without], variance[without], columns[without])
    np.testing.assert_allclose(whole.white[without], part.white, atol=1e-12)
    assert not whole.white[30].any()
    assert whole.log_determinant == pytest.approx(part.log_determinant)


def test_cutting_the_series_anywhere_changes_nothing(process, series):
    time, variance, columns = series
    whole = whiten(process, time, variance, columns)
    first = whiten(process, time[:23], variance[:23], columns[:23])
    rest = continue_whitening(process, first, time[23:], variance[23:], columns[23:])
    np.testing.assert_allclose(rest.white, whole.white[23:], atol=1e-12)
    np.testing.assert_allclose(rest.mean, whole.mean, atol=1e-12)
    np.testing.assert_allclose(rest.covariance, whole.covariance, atol=1e-12)


def test_inputs_are_left_as_they_were(process, series):
    kept = [part.copy() for part in series]
    whiten(process, *series)
    for part, before in zip(series, kept, strict=True):
        np.testing.assert_array_equal(part, before)
