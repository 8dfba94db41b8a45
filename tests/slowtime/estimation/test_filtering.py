"""Compiled passes over a series: the numbers of a step at a time, and of dense matrices."""

import numpy as np
import pytest

from slowtime.estimation import filtering, state_space
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Matern, Trend, quasi_periodic
from slowtime.estimation.sawtooth import Sawtooth
from tests.slowtime.estimation.matern_correlation import matern_correlation


def series(seed, count=60):
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(5.0, 50.0, count))
    time[7] = time[6]
    sd = rng.uniform(0.05, 0.3, count)
    value = np.sin(time / 5) + 0.05 * time + sd * rng.standard_normal(count)
    value[11] = np.nan
    return time, value, sd


def smooth(smoothness=1.5):
    return SlowProcess(
        smoothness=smoothness,
        length=np.array([3.0, 8.0, 20.0]),
        sd=np.array([0.5, 1.0, 0.2]),
        centre=0.3,
        level_sd=2.0,
        slope_sd=0.2,
        slope_drift=np.array([0.01, 0.002, 0.0]),
    )


def repeating():
    wave = quasi_periodic(
        period=np.array([9.0, 12.0, 7.0]), length=0.8, sd=0.4, memory=60.0, harmonics=2
    )
    saw = Sawtooth(
        period=np.array([6.0, 7.0, 8.0]), edge=np.array([1.0, 2.0, 3.0]), sd=0.3, memory=99.0
    )
    matern_part = Matern(length=np.array([3.0, 8.0, 20.0]), sd=0.5)
    return Trend(level_sd=2.0, slope_sd=0.2, drift=0.01) + matern_part + wave + saw


JUMPS = [(20.0, 0.7), (33.3, 0.4), (2.0, 0.1)]


def one_by_one(process, readings, jumps):
    """Belief and log-likelihood by a step at a time, with each jump just before its reading."""
    time, value, sd = readings
    belief, total, waiting = process.start(float(time[0])), np.zeros(3), sorted(jumps)
    for reading in zip(time.tolist(), value.tolist(), sd.tolist(), strict=True):
        while waiting and waiting[0][0] < reading[0]:
            belief = state_space.lifted(belief, waiting.pop(0)[1])
        belief, met = state_space.step(process, belief, *reading)
        total += met.log_likelihood
    return belief, total


@pytest.mark.parametrize(
    "process",
    [smooth(0.5), smooth(1.5), smooth(2.5), repeating()],
    ids=["rough", "once", "twice", "repeating"],
)
def test_a_compiled_pass_gives_the_numbers_of_a_step_at_a_time(process):
    readings = series(2)
    belief, likelihood = one_by_one(process, readings, JUMPS)
    found = filtering.filtered(process, *readings, jumps=JUMPS, innovations=True)
    np.testing.assert_allclose(found.belief.mean, belief.mean, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.belief.covariance, belief.covariance, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.log_likelihood, likelihood, rtol=1e-10)
    heard = np.isfinite(found.spread)
    assert (heard == np.isfinite(readings[1])).all()
    each = found.residual**2 / found.spread + np.log(2 * np.pi * found.spread)
    told = -0.5 * np.where(heard, each, 0.0).sum(axis=1)
    np.testing.assert_allclose(told, likelihood, rtol=1e-10)


@pytest.mark.parametrize("process", [smooth(2.5), repeating()], ids=["smooth", "repeating"])
def test_where_a_series_is_cut_changes_nothing_to_the_last_bit(process):
    time, value, sd = series(3)
    whole = filtering.filtered(process, time, value, sd).belief
    for cuts in ([1], [30], [13, 14, 40], range(1, 60)):
        parts = [np.split(x, list(cuts)) for x in (time, value, sd)]
        belief = process.start(float(time[0]))
        for part in zip(*parts, strict=True):
            belief = filtering.filtered(process, *part, belief=belief).belief
        np.testing.assert_array_equal(belief.mean, whole.mean)
        np.testing.assert_array_equal(belief.covariance, whole.covariance)


def dense_covariance(process, member, time, jumps):
    """Covariance of the readings by its formula, without any state."""
    apart = np.abs(time[:, None] - time) / process.length[member]
    u, v = np.meshgrid(time - time[0], time - time[0], indexing="ij")
    early, late = np.minimum(u, v), np.maximum(u, v)
    drift = early**2 * (late - early) / 2 + early**3 / 3
    found = (
        process.sd[member] ** 2 * matern_correlation(process.smoothness, apart)
        + process.level_sd**2
        + process.slope_sd**2 * u * v
        + process.slope_drift[member] ** 2 * drift
    )
    for at, sd in jumps:
        step = time > at
        found = found + sd**2 * np.outer(step, step)
    return found


@pytest.mark.parametrize("smoothness", [0.5, 1.5, 2.5])
@pytest.mark.parametrize("jumps", [[], JUMPS[:2]], ids=["none", "two"])
def test_all_places_of_a_jump_are_scored_as_dense_matrices_score_each(smoothness, jumps):
    """The gain at a place is that of a covariance that has grown by its step, of rank one."""
    time, value, sd = series(4)
    process, tau = smooth(smoothness), 0.8
    found = filtering.Passes(process, time).interventions(value, sd, jumps=jumps)
    gain = found.gain(tau)
    seen = np.isfinite(value)
    for member in range(3):
        covariance = dense_covariance(process, member, time, jumps) + np.diag(sd**2)
        inner = np.linalg.inv(covariance[np.ix_(seen, seen)])
        left = (value - process.centre)[seen]

        def log_density(matrix, left=left):
            return -0.5 * (
                left @ np.linalg.solve(matrix, left) + np.linalg.slogdet(2 * np.pi * matrix)[1]
            )

        plain = log_density(covariance[np.ix_(seen, seen)])
        assert found.log_likelihood[member] == pytest.approx(plain, rel=1e-9)
        for place in (1, 5, 11, 20, 42, 59):
            step = (np.arange(len(time)) >= place)[seen].astype(float)
            grown = covariance[np.ix_(seen, seen)] + tau**2 * np.outer(step, step)
            assert gain[member, place] == pytest.approx(log_density(grown) - plain, abs=1e-7)
            score, information = step @ inner @ left, step @ inner @ step
            assert found.score[member, place] == pytest.approx(score, rel=1e-6, abs=1e-7)
            assert found.information[member, place] == pytest.approx(information, rel=1e-6)
        # What all others say of a reading, from the inverse (Dubrule, 1983).
        pulls = (inner @ left) / np.sqrt(np.diag(inner))
        np.testing.assert_allclose(found.left_out[member, seen], pulls, rtol=1e-6, atol=1e-8)
    assert (found.left_out[:, ~seen] == 0.0).all()


def test_what_is_lost_without_a_jump_is_what_it_had_gained():
    time, value, sd = series(5)
    process = smooth()
    without = filtering.Passes(process, time).interventions(value, sd)
    for place in (3, 25, 50):
        jump = [(float(time[place - 1]), 0.6)]
        given = filtering.Passes(process, time).interventions(value, sd, jumps=jump)
        np.testing.assert_allclose(
            given.loss(0.6)[:, place], without.gain(0.6)[:, place], atol=1e-8
        )


@pytest.mark.parametrize("process", [smooth(2.5), repeating()], ids=["smooth", "repeating"])
def test_futures_have_the_mean_and_spread_that_are_foretold(process):
    belief = filtering.filtered(process, *series(6)).belief
    later = np.linspace(belief.time, belief.time + 15.0, 4)
    owners = np.repeat(np.arange(3), 4000)
    shocks = np.random.default_rng(7).standard_normal((12000, 5, belief.mean.shape[-1]))
    paths = filtering.sample(process, belief, later, owners, shocks).reshape(3, 4000, 4)
    mean, spread = state_space.predict(process, belief, later)
    np.testing.assert_allclose(paths.mean(axis=1), mean, atol=5.0 * spread.max() / 4000**0.5)
    np.testing.assert_allclose(paths.std(axis=1), spread, rtol=0.06)
