import numpy as np
import pytest

from slowtime.estimation import consistency, kalman, unscented
from slowtime.estimation.gaussian import Gaussian, root_of, smooth, triangular
from slowtime.estimation.particle import systematic


def bend(points, known):
    a, b, c = np.moveaxis(points, -1, 0)
    return np.stack([a * b, np.sin(b) + c, np.exp(0.3 * a), c**2], axis=-1)


def by_the_book(mean, covariance, alpha, beta, kappa):
    """Moments by the usual weights, one of which is negative."""
    n = len(mean)
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * covariance)
    points = np.array([mean, *(mean + root.T), *(mean - root.T)])
    of_mean = np.full(2 * n + 1, 0.5 / (n + lam))
    of_mean[0] = lam / (n + lam)
    of_spread = of_mean.copy()
    of_spread[0] += 1 - alpha**2 + beta
    found = bend(points, None)
    centre = of_mean @ found
    away = found - centre
    return centre, (of_spread[:, None] * away).T @ away


@pytest.mark.parametrize(
    ("alpha", "beta", "kappa"),
    [(1.0, 2.0, 0.0), (0.3, 2.0, 0.0), (1.0, 0.0, 0.0), (1.2, 0.0, 1.0), (0.02, 2.0, 0.0)],
)
def test_the_sum_of_squares_is_the_usual_covariance_with_its_negative_weight(
    alpha, beta, kappa
):
    mean = np.array([0.3, -0.8, 1.1])
    covariance = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.4]])
    one = unscented.Unscented(
        move=bend, read=bend, process_root=np.zeros((4, 1)), reading_noise=np.eye(4),
        alpha=alpha, beta=beta, kappa=kappa,
    )  # fmt: skip
    centre, deviations, fine = one._carry(bend, Gaussian.of(mean, covariance), None)
    expected, spread = by_the_book(mean, covariance, alpha, beta, kappa)
    assert fine
    np.testing.assert_allclose(centre, expected, atol=1e-9)
    np.testing.assert_allclose(deviations @ deviations.T, spread, atol=1e-9)


def test_the_authors_points_a_thousandth_wide_stay_positive_where_the_usual_sum_does_not():
    rng = np.random.default_rng(11)
    worst = np.inf
    for _ in range(50):
        mean, spread = rng.standard_normal(3), np.diag(rng.uniform(1e-14, 1e-12, 3))
        one = unscented.Unscented(
            move=bend, read=bend, process_root=np.zeros((4, 1)), reading_noise=np.eye(4),
            alpha=1e-3,
        )  # fmt: skip
        _, deviations, _ = one._carry(bend, Gaussian.of(mean, spread), None)
        assert np.linalg.svd(deviations, compute_uv=False).min() >= 0
        usual = by_the_book(mean, spread, 1e-3, 2.0, 0.0)[1]
        worst = min(worst, np.linalg.eigvalsh(usual).min() / np.abs(usual).max())
    assert worst < -1e-12


@pytest.mark.parametrize("keywords", [{"alpha": 0.0}, {"beta": -0.1}, {"kappa": -1.0}])
def test_settings_without_a_positive_covariance_are_refused(keywords):
    with pytest.raises(ValueError, match="Give alpha above 0"):
        unscented.Unscented(
            move=bend, read=bend, process_root=np.eye(1), reading_noise=np.eye(1), **keywords
        )


def test_a_model_that_overflows_away_from_its_mean_is_asked_nearer_or_left_out():
    def explode(points, known):
        return np.where(np.abs(points) > 3.0, np.inf, points)

    one = unscented.Unscented(
        move=explode, read=explode, process_root=np.zeros((1, 1)), reading_noise=np.eye(1)
    )
    mean, spread = np.array([[2.5], [0.1], [5.0]]), np.ones((3, 1, 1))
    belief, step = one.step(one.start(mean, spread), np.zeros((3, 1)))
    np.testing.assert_array_equal(step.rejected, [False, False, True])
    np.testing.assert_array_equal(step.used, [1, 1, 0])
    np.testing.assert_allclose(belief.mean[:, 0], [1.25, 0.05, 5.0])
    np.testing.assert_allclose(belief.covariance[:, 0, 0], [0.5, 0.5, 1.0])


def test_parameters_alone_are_learnt_from_what_the_model_would_read():
    rng = np.random.default_rng(12)

    def pulse(theta, times):
        return np.exp(theta[..., :1]) * np.exp(-np.exp(theta[..., 1:]) * times)

    times = np.linspace(0.0, 3.0, 15)
    one = unscented.Unscented(
        move=lambda theta, times: theta,
        read=pulse,
        process_root=np.zeros((2, 1)),
        reading_noise=1e-4 * np.eye(15),
    )
    belief = one.start(np.zeros(2), 0.5 * np.eye(2))
    truth = np.log(np.array([1.7, 0.6]))
    for _ in range(30):
        reading = pulse(truth, times) + 0.01 * rng.standard_normal(15)
        belief, _ = one.step(belief, reading, times)
    np.testing.assert_allclose(belief.mean, truth, atol=4 * belief.sd.max())
    assert belief.sd.max() < 0.01


@pytest.mark.long
def test_the_size_of_both_noises_is_learnt_from_innovations():
    rng = np.random.default_rng(13)
    level = np.cumsum(0.3 * rng.standard_normal(600))
    readings = level + 1.5 * rng.standard_normal(600)

    def likelihood(factors):
        one = kalman.Kalman(
            transition=np.eye(1),
            process_noise=factors[:, 0, None, None] * np.ones((1, 1)),
            observation=np.eye(1),
            reading_noise=factors[:, 1, None, None] * np.ones((1, 1)),
        )
        count = len(factors)
        belief = one.start(np.zeros((count, 1)), np.full((count, 1, 1), 4.0))
        total = np.zeros(count)
        for reading in readings:
            belief, step = one.step(belief, np.full((count, 1), reading))
            total += step.log_likelihood
        return total

    found = consistency.noise_factors(likelihood)
    assert np.log(found.process / 0.09) == pytest.approx(0.0, abs=3 * found.log_sd[0])
    assert np.log(found.reading / 2.25) == pytest.approx(0.0, abs=3 * found.log_sd[1])
    assert (found.log_sd < 0.5).all()


def test_systematic_drawing_takes_each_particle_as_often_as_its_weight_asks():
    rng = np.random.default_rng(14)
    weights = rng.dirichlet(np.ones(200), size=(3, 2))
    index = systematic(weights, rng.random((3, 2)))
    for i in range(3):
        for j in range(2):
            times = np.bincount(index[i, j], minlength=200)
            assert (np.abs(times - 200 * weights[i, j]) < 1.0 + 1e-9).all()
            assert (np.diff(index[i, j]) >= 0).all()


def test_roots_of_singular_covariances_are_roots_and_of_none_are_refused():
    singular = np.array([[1e-12, 1e-6, 0.0], [1e-6, 1.0, 0.0], [0.0, 0.0, 0.0]])
    root = root_of(singular)
    np.testing.assert_allclose(root @ root.T, singular, rtol=1e-7, atol=1e-30)
    assert (np.triu(root, 1) == 0).all()
    with pytest.raises(ValueError, match="eigenvalue -"):
        root_of(np.array([[1.0, 2.0], [2.0, 1.0]]))
    wide = np.random.default_rng(15).standard_normal((4, 2, 9))
    lower = triangular(wide)
    np.testing.assert_allclose(
        lower @ np.swapaxes(lower, -1, -2), wide @ np.swapaxes(wide, -1, -2), atol=1e-12
    )


def test_judging_nothing_is_refused():
    one = kalman.Kalman(
        transition=np.eye(1), process_noise=np.eye(1), observation=np.eye(1),
        reading_noise=np.eye(1),
    )  # fmt: skip
    steps = one.run(one.start(np.zeros(1), np.eye(1)), np.full((3, 1), np.nan))
    with pytest.raises(ValueError, match="Give steps with readings"):
        consistency.nis(steps)
    assert smooth(steps)[0].mean == 0.0
