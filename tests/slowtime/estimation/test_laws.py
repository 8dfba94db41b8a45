"""Laws of every filter of this room, run over all of them."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from slowtime.estimation import consistency, kalman, particle, unscented
from slowtime.estimation.gaussian import smooth

F = np.array([[0.95, 0.2], [-0.3, 0.9]])
H = np.array([[1.0, 0.0], [0.5, 1.0]])
Q_ROOT = np.array([[0.1, 0.0], [0.05, 0.2]])
R = np.array([[0.04, 0.01], [0.01, 0.09]])
MEAN, COVARIANCE = np.array([0.5, -0.5]), np.diag([1.0, 0.5])


def moved(points, known):
    return points @ F.T + (0.0 if known is None else known)


def moved_at_random(points, known, rng):
    return moved(points, known) + rng.standard_normal(points.shape) @ Q_ROOT.T


def seen(points, known):
    return points @ H.T


def swing(points, known):
    """A pendulum, half a step of Heun."""
    angle, rate = points[..., 0], points[..., 1]
    force = 0.0 if known is None else known
    half = rate + 0.05 * (force - np.sin(angle) - 0.1 * rate)
    ahead = angle + 0.1 * half
    return np.stack([ahead, rate + 0.1 * (force - np.sin(ahead) - 0.1 * half)], axis=-1)


def seen_from_the_side(points, known):
    return np.stack([np.sin(points[..., 0]), points[..., 1]], axis=-1)


LINEAR: dict[str, Any] = {"process_root": Q_ROOT, "reading_noise": R}
FILTERS: dict[str, Any] = {
    "Kalman": kalman.Kalman(
        transition=F, process_noise=Q_ROOT @ Q_ROOT.T, observation=H, reading_noise=R
    ),
    "unscented": unscented.Unscented(move=moved, read=seen, **LINEAR),
    "unscented, narrow": unscented.Unscented(move=moved, read=seen, alpha=1e-3, **LINEAR),
    "unscented, cubature": unscented.Unscented(move=moved, read=seen, beta=0.0, **LINEAR),
    "unscented, pendulum": unscented.Unscented(move=swing, read=seen_from_the_side, **LINEAR),
    "particles": particle.ParticleFilter(
        move=moved_at_random, read=seen, reading_noise=R, particles=4000
    ),
}
EVERY = pytest.mark.parametrize("name", FILTERS)
GAUSSIAN = pytest.mark.parametrize("name", [name for name in FILTERS if name != "particles"])
LINEAR_ONES = [name for name in FILTERS if "pendulum" not in name]


def record(seed, twins=(), count=25):
    rng = np.random.default_rng(seed)
    root_r = np.linalg.cholesky(R)
    state = MEAN + rng.standard_normal((*twins, 2)) @ np.sqrt(COVARIANCE)
    states, readings = [], []
    for _ in range(count):
        state = moved_at_random(state, None, rng)
        states.append(state)
        readings.append(state @ H.T + rng.standard_normal((*twins, 2)) @ root_r.T)
    return np.array(states), np.array(readings)


def start(one, twins=()):
    return one.start(
        np.broadcast_to(MEAN, (*twins, 2)).copy(),
        np.broadcast_to(COVARIANCE, (*twins, 2, 2)).copy(),
    )


def run(one, belief, readings):
    steps = []
    for reading in readings:
        belief, step = one.step(belief, reading)
        steps.append(step)
    return belief, steps


@EVERY
def test_covariances_are_symmetric_and_positive_and_all_is_finite(name):
    one = FILTERS[name]
    _, steps = run(one, start(one, (3,)), record(1, (3,))[1])
    for step in steps:
        for belief in (step.predicted, step.updated):
            covariance = belief.covariance
            np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
            assert (np.linalg.eigvalsh(covariance) > 0).all()
            assert np.isfinite(belief.mean).all()
            np.testing.assert_allclose(
                belief.sd**2, np.diagonal(covariance, axis1=-2, axis2=-1), rtol=1e-10
            )
        assert np.isfinite(step.log_likelihood).all()


@EVERY
def test_a_step_is_a_function_of_what_it_is_given_and_changes_none_of_it(name):
    one, readings = FILTERS[name], record(2)[1]
    belief = start(one)
    before, kept = copy.deepcopy(belief), readings.copy()
    after, _ = one.step(belief, readings[0])
    again, _ = one.step(before, kept[0])
    np.testing.assert_array_equal(after.mean, again.mean)
    np.testing.assert_array_equal(after.covariance, again.covariance)
    np.testing.assert_array_equal(belief.covariance, before.covariance)
    np.testing.assert_array_equal(readings, kept)


@EVERY
def test_a_belief_that_was_kept_on_disk_goes_on_as_if_nothing_had_been(name):
    one, readings = FILTERS[name], record(3)[1]
    whole, _ = run(one, start(one), readings)
    part, _ = run(one, start(one), readings[:11])
    resumed, _ = run(one, pickle.loads(pickle.dumps(part)), readings[11:])
    np.testing.assert_array_equal(resumed.mean, whole.mean)
    np.testing.assert_array_equal(resumed.covariance, whole.covariance)


@GAUSSIAN
def test_many_twins_at_once_are_each_as_if_alone(name):
    one, readings = FILTERS[name], record(4, (2, 3))[1]
    readings[7, 1, 2], readings[9, 0, 0, 1] = np.nan, np.nan
    _, together = run(one, start(one, (2, 3)), readings)
    for i, j in ((0, 0), (1, 2)):
        _, alone = run(one, start(one), readings[:, i, j])
        for both, own in zip(together, alone, strict=True):
            np.testing.assert_allclose(both.updated.mean[i, j], own.updated.mean, atol=1e-12)
            np.testing.assert_allclose(
                both.updated.covariance[i, j], own.updated.covariance, atol=1e-12
            )
            assert both.log_likelihood[i, j] == pytest.approx(float(own.log_likelihood))


@EVERY
def test_a_missing_reading_is_a_step_of_its_own(name):
    one = FILTERS[name]
    belief = start(one)
    for reading in (np.full(2, np.nan), np.array([0.4, np.nan])):
        after, step = one.step(belief, reading)
        assert step.used == np.isfinite(reading).sum()
        assert not step.rejected
        np.testing.assert_array_equal(np.isnan(step.residual), np.isnan(reading))
    missed, step = one.step(belief, np.full(2, np.nan))
    np.testing.assert_allclose(missed.mean, step.predicted.mean, atol=1e-14)
    np.testing.assert_allclose(missed.covariance, step.predicted.covariance, atol=1e-14)
    assert step.log_likelihood == step.surprise == 0.0
    assert after.sd[0] < missed.sd[0]


@EVERY
def test_a_reading_of_no_sense_is_rejected_and_the_step_says_so(name):
    one = copy.copy(FILTERS[name])
    object.__setattr__(one, "gate", 1e-6)
    belief, _ = run(one, start(one), record(5)[1][:3])
    spoilt, step = one.step(belief, np.array([40.0, 0.0]))
    missed, _ = one.step(belief, np.full(2, np.nan))
    assert step.rejected
    assert step.used == 0
    assert step.surprise > 100
    assert step.log_likelihood == 0.0
    np.testing.assert_allclose(spoilt.mean, missed.mean, atol=1e-14)
    np.testing.assert_allclose(spoilt.covariance, missed.covariance, atol=1e-14)


@pytest.mark.parametrize("name", LINEAR_ONES)
def test_on_a_linear_system_all_agree_with_kalman(name):
    readings = record(6)[1]
    readings[4, 0] = readings[9] = np.nan
    one = FILTERS[name]
    _, steps = run(one, start(one), readings)
    _, exact = run(FILTERS["Kalman"], start(FILTERS["Kalman"]), readings)
    close = 0.06 if name == "particles" else 1e-6 if "narrow" in name else 1e-11
    for found, true in zip(steps, exact, strict=True):
        np.testing.assert_allclose(found.updated.mean, true.updated.mean, atol=close)
        np.testing.assert_allclose(
            found.updated.covariance, true.updated.covariance, atol=close
        )
    total = sum(float(step.log_likelihood) for step in steps)
    assert total == pytest.approx(
        sum(float(step.log_likelihood) for step in exact),
        abs=1.0 if name == "particles" else 1e3 * close,
    )


@pytest.mark.parametrize("name", LINEAR_ONES)
def test_a_right_model_passes_its_own_tests_and_a_wrong_noise_fails_them(name):
    one = FILTERS[name]
    states, readings = record(7, (60,))
    if name == "particles":
        one = particle.ParticleFilter(
            move=moved_at_random, read=seen, reading_noise=R, particles=800
        )
    _, steps = run(one, start(one, (60,)), readings)
    surprise = consistency.nis(steps, level=0.999)
    assert surprise.consistent.mean() > 0.97
    last = [type_of(steps[-1].updated, i) for i in range(60)]
    errors = consistency.nees(states[-1], last, level=0.999)
    assert errors.consistent
    wrong = consistency.nees(states[-1] + 0.5 * last[0].sd, last, level=0.95)
    assert wrong.ratio > errors.ratio


def type_of(belief, i):
    """One twin's belief out of many."""
    if isinstance(belief, particle.Particles):
        return particle.Particles(belief.points[i], belief.weights[i], belief.seed)
    return kalman.Gaussian(belief.mean[i], belief.root[i])


@GAUSSIAN
def test_the_past_is_smoothed_to_no_worse_than_it_was_filtered(name):
    one = FILTERS[name]
    _, steps = run(one, start(one, (2,)), record(8, (2,))[1])
    smoothed = smooth(steps)
    np.testing.assert_array_equal(smoothed[-1].mean, steps[-1].updated.mean)
    for step, later in zip(steps, smoothed, strict=True):
        gained = step.updated.covariance - later.covariance
        assert np.linalg.eigvalsh(gained).min() > -1e-12


@pytest.mark.parametrize("name", ["unscented", "unscented, cubature"])
def test_unscented_smoothing_of_a_linear_system_is_that_of_kalman(name):
    readings = record(9)[1]
    one, exact = FILTERS[name], FILTERS["Kalman"]
    found = smooth(run(one, start(one), readings)[1])
    true = smooth(run(exact, start(exact), readings)[1])
    for a, b in zip(found, true, strict=True):
        np.testing.assert_allclose(a.mean, b.mean, atol=1e-11)
        np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-11)
