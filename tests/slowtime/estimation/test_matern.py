import dataclasses
import pickle

import numpy as np
import pytest
from scipy import linalg

from slowtime.estimation import filtering, kernels, state_space
from slowtime.estimation.hyperparameters import fit, quasi_random_points
from slowtime.estimation.matern import SlowProcess

SMOOTHNESS = pytest.mark.parametrize("smoothness", [0.5, 1.5, 2.5])


def textbook(smoothness, distance):
    """Matern correlations as every textbook prints them."""
    d = np.abs(distance)
    if smoothness == 0.5:
        return np.exp(-d)
    if smoothness == 1.5:
        return (1 + np.sqrt(3) * d) * np.exp(-np.sqrt(3) * d)
    return (1 + np.sqrt(5) * d + 5 * d**2 / 3) * np.exp(-np.sqrt(5) * d)


def covariance(process, a, b, origin):
    k = process.sd**2 * textbook(process.smoothness, (a[:, None] - b) / process.length)
    u, v = a[:, None] - origin, b - origin
    early, late = np.minimum(u, v), np.maximum(u, v)
    wandering = early**2 * (late - early) / 2 + early**3 / 3
    return (
        k
        + process.level_sd**2
        + process.slope_sd**2 * u * v
        + process.slope_drift**2 * wandering
    )


def dense(process, time, value, sd, at):
    """The Gaussian process by its n by n matrices."""
    inner = covariance(process, time, time, time[0]) + np.diag(sd**2)
    cross = covariance(process, at, time, time[0])
    residual = value - process.centre
    mean = process.centre + cross @ np.linalg.solve(inner, residual)
    own = covariance(process, at, at, time[0])
    variance = np.diag(own - cross @ np.linalg.solve(inner, cross.T))
    likelihood = -0.5 * (
        residual @ np.linalg.solve(inner, residual) + np.linalg.slogdet(2 * np.pi * inner)[1]
    )
    return mean, np.sqrt(variance), likelihood


def series(seed, count=80):
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(5.0, 50.0, count))
    sd = rng.uniform(0.05, 0.3, count)
    return time, np.sin(time / 5) + 0.05 * time + sd * rng.standard_normal(count), sd


MEANS = pytest.mark.parametrize(
    "mean",
    [
        {},
        {"centre": 2.0, "level_sd": 3.0},
        {"level_sd": 3.0, "slope_sd": 0.5},
        {"level_sd": 3.0, "slope_sd": 0.5, "slope_drift": 0.05},
    ],
    ids=["zero", "constant", "straight", "drifting"],
)


@SMOOTHNESS
@MEANS
def test_smoothed_series_and_likelihood_are_those_of_the_dense_process(smoothness, mean):
    process = SlowProcess(smoothness=smoothness, length=4.0, sd=0.8, **mean)
    time, value, sd = series(81)
    expected, expected_sd, likelihood = dense(process, time, value, sd, time)
    found = filtering.smooth(process, time, value, sd)
    np.testing.assert_allclose(found.mean, expected, atol=1e-8)
    np.testing.assert_allclose(found.sd, expected_sd, atol=1e-8)
    assert filtering.log_likelihood(process, time, value, sd) == pytest.approx(
        likelihood, abs=1e-8
    )


@SMOOTHNESS
@MEANS
def test_predictions_and_gaps_are_those_of_the_dense_process(smoothness, mean):
    process = SlowProcess(smoothness=smoothness, length=4.0, sd=0.8, **mean)
    time, value, sd = series(82)
    later = np.array([50.5, 53.0, 90.0])
    expected, expected_sd, _ = dense(process, time, value, sd, later)
    belief = filtering.filtered(process, time, value, sd).belief
    found, found_sd = state_space.predict(process, belief, later)
    np.testing.assert_allclose(found, expected, atol=1e-8)
    np.testing.assert_allclose(found_sd, expected_sd, atol=1e-8)

    asked = np.linspace(5.5, 49.5, 17)
    asked = asked[asked > time[0]]
    merged = np.concatenate([time, asked])
    order = np.argsort(merged)
    padded = np.concatenate([value, np.full(len(asked), np.nan)])[order]
    smoothed = filtering.smooth(process, merged[order], padded, np.append(sd, 0 * asked)[order])
    inside = np.isnan(padded)
    expected, expected_sd, _ = dense(process, time, value, sd, asked)
    np.testing.assert_allclose(smoothed.mean[inside], expected, atol=1e-8)
    np.testing.assert_allclose(smoothed.sd[inside], expected_sd, atol=1e-8)


@SMOOTHNESS
def test_the_transition_is_the_exponential_of_the_generator(smoothness):
    generator = {
        0.5: np.array([[-1.0]]),
        1.5: np.array([[0.0, 1.0], [-1.0, -2.0]]),
        2.5: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]]),
    }[smoothness]
    for s in (0.0, 0.01, 0.7, 9.0):
        found = kernels.matern_transition(smoothness, np.array([s]))[0]
        np.testing.assert_allclose(found, linalg.expm(generator * s), atol=1e-14)


@SMOOTHNESS
def test_readings_one_by_one_give_what_the_whole_series_gives(smoothness):
    process = SlowProcess(smoothness=smoothness, length=4.0, sd=0.8, level_sd=2.0)
    time, value, sd = series(83, count=20)
    whole = filtering.filtered(process, time, value, sd).belief
    belief, likelihoods = process.start(time[0]), []
    for t, y, s in zip(time, value, sd, strict=True):
        belief, reading = state_space.step(process, belief, t, y, s)
        likelihoods.append(reading.log_likelihood)
    np.testing.assert_allclose(belief.mean, whole.mean, atol=1e-13)
    np.testing.assert_allclose(belief.covariance, whole.covariance, atol=1e-13)
    assert sum(likelihoods) == pytest.approx(filtering.log_likelihood(process, time, value, sd))


def test_a_family_gives_what_each_member_gives():
    time, value, sd = series(84, count=30)
    length, spread_ = np.array([1.0, 4.0, 9.0]), np.array([0.3, 0.8, 2.0])
    family = SlowProcess(length=length, sd=spread_, level_sd=2.0, slope_drift=length / 100)
    together = filtering.log_likelihood(family, time, value, sd)
    belief = filtering.filtered(family, time, value, sd).belief
    means, sds = state_space.predict(family, belief, np.array([51.0, 60.0]))
    for i in range(3):
        one = dataclasses.replace(
            family, length=length[i], sd=spread_[i], slope_drift=length[i] / 100
        )
        alone = filtering.filtered(one, time, value, sd).belief
        assert together[i] == pytest.approx(filtering.log_likelihood(one, time, value, sd))
        mean, sd_ = state_space.predict(one, alone, np.array([51.0, 60.0]))
        np.testing.assert_allclose(means[i], mean, atol=1e-12)
        np.testing.assert_allclose(sds[i], sd_, atol=1e-12)


def test_readings_at_the_same_time_are_as_good_as_their_mean():
    process = SlowProcess(length=4.0, sd=0.8)
    twice = filtering.filtered(
        process, np.array([0.0, 1.0, 1.0]), np.array([0.1, 0.4, 0.6]), np.full(3, 0.2)
    ).belief
    once = filtering.filtered(
        process, np.array([0.0, 1.0]), np.array([0.1, 0.5]), np.array([0.2, 0.2 / np.sqrt(2)])
    ).belief
    np.testing.assert_allclose(twice.mean, once.mean, atol=1e-14)
    np.testing.assert_allclose(twice.covariance, once.covariance, atol=1e-14)


def test_very_close_readings_do_no_harm_to_the_smoother():
    process = SlowProcess(smoothness=2.5, length=100.0, sd=1.0, level_sd=10.0)
    time = np.cumsum(np.full(300, 1e-4))
    rng = np.random.default_rng(85)
    found = filtering.smooth(
        process, time, 5 + 0.1 * rng.standard_normal(300), np.full(300, 0.1)
    )
    np.testing.assert_allclose(found.mean, 5.0, atol=0.03)
    np.testing.assert_allclose(found.sd, 0.1 / np.sqrt(300), rtol=0.02)


@pytest.mark.long
def test_what_is_carried_on_from_a_reading_is_as_small_after_thousands_as_at_first():
    process = SlowProcess(length=4.0, sd=0.8, level_sd=2.0)
    belief = process.start(0.0)
    at_first = len(pickle.dumps(belief))
    for _ in range(4_000):
        belief, _ = state_space.step(process, belief, belief.time + 0.1, 0.3, 0.1)
    assert len(pickle.dumps(belief)) == at_first


@pytest.mark.long
@SMOOTHNESS
def test_hyperparameters_are_found_again_and_no_neighbour_is_likelier(smoothness):
    rng = np.random.default_rng(86)
    truth = SlowProcess(smoothness=smoothness, length=5.0, sd=0.7)
    time = np.sort(rng.uniform(0, 300, 600))
    root = np.linalg.cholesky(covariance(truth, time, time, 0.0) + 1e-9 * np.eye(600))
    sd = np.full(600, 0.1)
    value = 3.0 + root @ rng.standard_normal(600) + sd * rng.standard_normal(600)
    found = fit(time, value, sd, smoothness=smoothness)
    assert np.log(found.process.length / 5.0) == pytest.approx(0.0, abs=0.35)
    assert np.log(found.process.sd / 0.7) == pytest.approx(0.0, abs=0.35)
    for factor in (0.9, 1.1):
        for name in ("length", "sd"):
            other = dataclasses.replace(
                found.process, **{name: getattr(found.process, name) * factor}
            )
            # the weak prior may move the optimum of the likelihood by a little
            assert (
                filtering.log_likelihood(other, time, value, sd) < found.log_likelihood + 0.05
            )


@pytest.mark.long
def test_the_bands_of_the_smoother_cover():
    rng = np.random.default_rng(87)
    inside = []
    for _ in range(30):
        process = SlowProcess(length=8.0, sd=0.5)
        time = np.sort(rng.uniform(0, 100, 60))
        root = np.linalg.cholesky(covariance(process, time, time, 0.0) + 1e-10 * np.eye(60))
        truth = 2.0 + root @ rng.standard_normal(60)
        sd = rng.uniform(0.1, 0.4, 60)
        value = truth + sd * rng.standard_normal(60)
        found = filtering.smooth(fit(time, value, sd).process, time, value, sd)
        inside.append(np.abs(found.mean - truth) <= 1.96 * found.sd)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)


def test_the_net_of_the_search_is_even_and_always_the_same():
    points = quasi_random_points(256, 3)
    np.testing.assert_array_equal(points, quasi_random_points(256, 3))
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.06)
    np.testing.assert_allclose(np.cov(points.T), np.eye(3), atol=0.1)


@pytest.mark.parametrize(
    ("keywords", "cure"),
    [
        ({"length": 0.0, "sd": 1.0}, "in the unit of the times"),
        ({"length": 1.0, "sd": -1.0}, "Give 0 to leave one out"),
        ({"length": 1.0, "sd": 1.0, "smoothness": 2.0}, "Give 1.5 when unsure"),
    ],
)
def test_what_is_no_process_is_refused_with_the_cure(keywords, cure):
    with pytest.raises(ValueError, match=cure):
        SlowProcess(**keywords)


def test_time_going_back_is_refused():
    process = SlowProcess(length=1.0, sd=1.0)
    with pytest.raises(ValueError, match="ascending order"):
        state_space.step(process, process.start(3.0), 2.0, 0.0, 0.1)


def test_too_few_readings_to_learn_from_are_refused():
    with pytest.raises(ValueError, match="at least 3 readings"):
        fit(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.full(2, 0.1))
