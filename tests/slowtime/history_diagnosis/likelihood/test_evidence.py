import numpy as np
import pytest
from scipy import stats

from slowtime.history_diagnosis.likelihood import evidence
from slowtime.history_diagnosis.likelihood.whitening import MaternProcess, whiten

WANDER = MaternProcess(1.5, 0.3, 0.5)


@pytest.fixture
def series(rng):
    time = np.sort(rng.uniform(0.0, 1.0, 40))
    columns = np.column_stack([np.ones(40), rng.standard_normal((40, 3))])
    reading = columns[:, 1] + rng.standard_normal(40)
    return time, reading, columns


def filtered(time, *columns):
    return whiten(WANDER, time, np.full(len(time), 0.2), np.column_stack(columns))


def dense_log_evidence(time, reading, columns, variance):
    """Multivariate Student, by the dense covariance: no filter, no least squares."""
    units = filtered(time, np.eye(len(time)))
    whitening = units.white
    covariance = np.linalg.inv(whitening.T @ whitening)
    covariance = covariance + (columns * variance) @ columns.T
    dof = round(2.0 * evidence.NOISE_PRIOR)
    return stats.multivariate_t(shape=covariance, df=dof).logpdf(reading)


def test_evidence_is_the_dense_student_density(series):
    time, reading, columns = series
    variance = np.array([100.0, 1.0, 0.5, 2.0])
    few = np.array([100.0, 1.0])
    whole = evidence.coefficient_posterior(
        filtered(time, reading, columns), variance, 40
    ).log_evidence
    part = evidence.coefficient_posterior(
        filtered(time, reading, columns[:, :2]), few, 40
    ).log_evidence
    dense = dense_log_evidence(time, reading, columns, variance)
    assert whole - part == pytest.approx(
        dense - dense_log_evidence(time, reading, columns[:, :2], few), rel=1e-8
    )


def test_many_additions_at_once_are_each_as_if_alone(series):
    time, reading, columns = series
    base = filtered(time, reading, columns[:, :1])
    added = filtered(time, columns[:, 1:]).white.reshape(40, 3, 1)
    prior = np.array([[1.0], [0.5], [2.0]])
    found = evidence.log_evidence_of_additions(base, np.array([100.0]), added, prior, 40)
    for i in range(3):
        alone = evidence.coefficient_posterior(
            filtered(time, reading, columns[:, 0], columns[:, 1 + i]),
            np.array([100.0, prior[i, 0]]),
            40,
        )
        assert found[i] == pytest.approx(alone.log_evidence)


def test_the_factor_of_the_noise_is_found(rng):
    time = np.linspace(0.0, 1.0, 4000)
    quiet = MaternProcess(0.5, 1.0, 0.0)
    reading = 1.4 * rng.standard_normal(4000)
    white = whiten(quiet, time, np.ones(4000), np.column_stack([reading, np.ones(4000)]))
    found = evidence.coefficient_posterior(white, np.array([100.0]), 4000)
    assert np.sqrt(found.noise_variance) == pytest.approx(1.4, rel=0.03)
