import numpy as np
import pytest

from slowtime.estimation.kalman import Kalman, smooth

RNG_SEED = 71


def model(rng, states=3, readings=2):
    def covariance(size):
        root = rng.standard_normal((size, size))
        return root @ root.T + 0.1 * np.eye(size)

    return Kalman(
        transition=0.5 * rng.standard_normal((states, states)),
        process_noise=covariance(states),
        observation=rng.standard_normal((readings, states)),
        reading_noise=covariance(readings),
    )


def batch(kalman, mean, covariance, readings):
    """Posterior of all states at once: one large Gaussian, conditioned on what was read."""
    f, q, h, r = (
        kalman.transition, kalman.process_noise, kalman.observation, kalman.reading_noise,
    )  # fmt: skip
    count, size = len(readings), len(mean)
    means, blocks = [], np.zeros((count, size, count, size))
    now_mean, now = mean, covariance
    for k in range(count):
        now_mean, now = f @ now_mean, f @ now @ f.T + q
        means.append(now_mean)
        carried = now
        for j in range(k, count):
            blocks[j, :, k, :] = carried
            blocks[k, :, j, :] = carried.T
            carried = f @ carried
    prior = blocks.reshape(count * size, count * size)
    big_h, big_r = np.kron(np.eye(count), h), np.kron(np.eye(count), r)
    seen = ~np.isnan(readings.ravel())
    big_h, big_r = big_h[seen], big_r[np.ix_(seen, seen)]
    residual = readings.ravel()[seen] - big_h @ np.concatenate(means)
    spread = big_h @ prior @ big_h.T + big_r
    gain = np.linalg.solve(spread, big_h @ prior).T
    mean = np.concatenate(means) + gain @ residual
    covariance = prior - gain @ big_h @ prior
    likelihood = -0.5 * (
        residual @ np.linalg.solve(spread, residual) + np.linalg.slogdet(2 * np.pi * spread)[1]
    )
    shaped = covariance.reshape(count, size, count, size)
    return mean.reshape(count, size), np.einsum("kikj->kij", shaped), likelihood


@pytest.mark.parametrize("missing", [False, True])
def test_filter_and_smoother_are_the_batch_posterior(missing):
    rng = np.random.default_rng(RNG_SEED)
    kalman = model(rng)
    readings = rng.standard_normal((12, 2))
    if missing:
        readings[3] = np.nan
        readings[5, 1] = readings[0, 0] = readings[11, 0] = np.nan
    mean, covariance = rng.standard_normal(3), 2.0 * np.eye(3)
    steps = kalman.run(kalman.start(mean, covariance), readings)
    for k in range(12):
        means, covariances, likelihood = batch(kalman, mean, covariance, readings[: k + 1])
        np.testing.assert_allclose(steps[k].updated.mean, means[-1], atol=1e-12)
        np.testing.assert_allclose(steps[k].updated.covariance, covariances[-1], atol=1e-12)
    assert sum(step.log_likelihood for step in steps) == pytest.approx(likelihood, abs=1e-11)
    for found, m, c in zip(smooth(steps), means, covariances, strict=True):
        np.testing.assert_allclose(found.mean, m, atol=1e-12)
        np.testing.assert_allclose(found.covariance, c, atol=1e-12)


@pytest.mark.long
def test_if_the_model_is_right_the_mean_surprise_is_the_dimension_of_a_reading():
    rng = np.random.default_rng(72)
    kalman = model(rng)
    f, h = kalman.transition * 0.5, kalman.observation
    kalman = Kalman(
        transition=f, process_noise=kalman.process_noise, observation=h,
        reading_noise=kalman.reading_noise,
    )  # fmt: skip
    root_q = np.linalg.cholesky(kalman.process_noise)
    root_r = np.linalg.cholesky(kalman.reading_noise)
    state, readings = np.zeros(3), []
    for _ in range(4_000):
        state = f @ state + root_q @ rng.standard_normal(3)
        readings.append(h @ state + root_r @ rng.standard_normal(2))
    steps = kalman.run(kalman.start(np.zeros(3), np.zeros((3, 3))), np.array(readings))
    assert np.mean([step.surprise for step in steps]) == pytest.approx(2.0, abs=0.13)


def test_a_tracked_random_walk_settles_at_its_known_variance():
    q, v = 0.3, 2.0
    kalman = Kalman(
        transition=np.eye(1), process_noise=np.full((1, 1), q), observation=np.eye(1),
        reading_noise=np.full((1, 1), v),
    )  # fmt: skip
    steps = kalman.run(kalman.start(np.zeros(1), np.eye(1)), np.zeros((80, 1)))
    expected = (-q + np.sqrt(q**2 + 4 * q * v)) / 2
    assert steps[-1].updated.covariance[0, 0] == pytest.approx(expected, rel=1e-12)


def test_covariances_stay_symmetric_and_positive_through_nearly_exact_readings():
    kalman = Kalman(
        transition=np.array([[1.0, 1.0], [0.0, 1.0]]), process_noise=1e-12 * np.eye(2),
        observation=np.array([[1.0, 0.0]]), reading_noise=np.full((1, 1), 1e-14),
    )  # fmt: skip
    steps = kalman.run(kalman.start(np.zeros(2), 1e6 * np.eye(2)), np.zeros((200, 1)))
    for step in steps:
        np.testing.assert_array_equal(step.updated.covariance, step.updated.covariance.T)
        values = np.linalg.eigvalsh(step.updated.covariance)
        assert values.min() >= -1e-15 * values.max()


def test_a_perfectly_known_state_is_smoothed_without_complaint():
    kalman = Kalman(
        transition=np.eye(2), process_noise=np.zeros((2, 2)), observation=np.ones((1, 2)),
        reading_noise=np.ones((1, 1)),
    )  # fmt: skip
    steps = kalman.run(kalman.start(np.ones(2), np.zeros((2, 2))), np.ones((5, 1)))
    for belief in smooth(steps):
        np.testing.assert_allclose(belief.mean, 1.0)
        np.testing.assert_allclose(belief.covariance, 0.0)
    assert smooth([]) == []


def test_a_lopsided_covariance_is_refused_with_the_cure():
    kalman = model(np.random.default_rng(73))
    with pytest.raises(ValueError, match="not a factor of it"):
        kalman.start(np.zeros(3), np.triu(np.ones((3, 3))))
