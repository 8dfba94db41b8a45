"""Samples of a truncated normal distribution have the moments that rejection sampling gives."""

import numpy as np
import pytest
import scipy.stats

from slowtime.discrepancy.refinement.force_surface.truncated_normal import truncated_normal

FAR = np.inf


def test_one_variable_has_the_moments_of_scipy():
    found = truncated_normal(np.array([[4.0]]), np.array([-0.3]), np.array([FAR]), 4000)[:, 0]
    truth = scipy.stats.truncnorm(-0.15, FAR, scale=2.0)
    assert found.min() >= -0.3
    assert found.mean() == pytest.approx(truth.mean(), rel=0.05)
    assert found.std() == pytest.approx(truth.std(), rel=0.05)


def test_several_variables_have_the_moments_of_rejection_sampling():
    rng = np.random.default_rng(4)
    half = rng.standard_normal((4, 5))
    covariance = half @ half.T + 0.05 * np.eye(4)
    low, high = np.array([-0.2, -FAR, -0.1, -FAR]), np.array([FAR, 0.5, FAR, FAR])
    found = truncated_normal(covariance, low, high, 4000)
    drawn = rng.multivariate_normal(np.zeros(4), covariance, 400_000)
    kept = drawn[((drawn >= low) & (drawn <= high)).all(axis=1)]
    assert ((found >= low) & (found <= high)).all()
    np.testing.assert_allclose(found.mean(0), kept.mean(0), atol=0.06 * kept.std(0).max())
    np.testing.assert_allclose(np.cov(found.T), np.cov(kept.T), atol=0.1 * kept.var(0).max())


def test_without_bounds_it_is_the_normal_distribution():
    covariance = np.array([[2.0, 0.9], [0.9, 1.0]])
    far = np.full(2, FAR)
    found = truncated_normal(covariance, -far, far, 4000)
    np.testing.assert_allclose(np.cov(found.T), covariance, atol=0.12)


def test_samples_are_the_same_again():
    args = np.eye(2), np.zeros(2), np.full(2, FAR), 20
    np.testing.assert_array_equal(truncated_normal(*args), truncated_normal(*args))
