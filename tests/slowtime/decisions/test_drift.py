import numpy as np
import pytest
from scipy import special, stats

from slowtime.decisions import drift

STEP, SD = 0.1, 0.05


def dense(readings, q, guess):
    """Mean of (D, rate) after readings, by conditioning of one Gaussian vector."""
    time = STEP * np.arange(1, len(readings) + 1)
    prior = (drift.DIFFUSE * guess) ** 2
    cov_d = q * np.minimum.outer(time, time) + prior * np.outer(time, time)
    noisy = cov_d + SD**2 * np.eye(len(time))
    off = readings - guess * time
    with_d, with_rate = cov_d[-1], prior * time
    solved = np.linalg.solve(noisy, np.column_stack([off, with_d, with_rate]))
    mean = guess * time[-1] + with_d @ solved[:, 0], guess + with_rate @ solved[:, 0]
    var = cov_d[-1, -1] - with_d @ solved[:, 1], prior - with_rate @ solved[:, 2]
    return mean, var, float(stats.multivariate_normal(guess * time, noisy).logpdf(readings))


def test_the_filter_without_acceleration_is_a_dense_gaussian():
    rng = np.random.default_rng(5)
    readings = np.cumsum(rng.normal(0.01, 0.01, (12, 3)), axis=0)
    belief = drift.start((3,), 0.1)
    for row in readings:
        belief = drift.read(drift.advance(belief, STEP), row, SD)
    for k, q in enumerate(drift.VARIANCES):
        row = k * len(drift.ACCELERATIONS)
        total = 0.0
        for asset in range(3):
            mean, var, score = dense(readings[:, asset], q, 0.1)
            assert belief.place[row, asset] == pytest.approx(mean[0], abs=1e-6)
            assert belief.rate[row, asset] == pytest.approx(mean[1], abs=1e-5)
            assert belief.pdd[row, asset] == pytest.approx(var[0], rel=1e-4)
            assert belief.prr[row, asset] == pytest.approx(var[1], rel=1e-4)
            total += score + 12 / 2 * np.log(2 * np.pi)
        assert belief.evidence[row] == pytest.approx(total, abs=1e-3)


def test_a_reading_that_is_missing_changes_nothing():
    belief = drift.advance(drift.start((2,), 0.1), STEP)
    same = drift.read(belief, np.full(2, np.nan), SD)
    np.testing.assert_array_equal(same.place, belief.place)
    np.testing.assert_array_equal(same.evidence, belief.evidence)


def test_coordinates_of_damage_run_from_new_to_failed():
    for c in (0.0, 0.7, 2.0):
        ends = drift.damage_at(np.array([0.0, 1.0]), np.array(c))
        np.testing.assert_allclose(ends, [0.0, 1.0], atol=1e-6)
        small = 1e-6
        near = drift.damage_at(np.array([0.4 - small, 0.4 + small]), np.array(c))
        slope = drift.slope_at(np.array([0.4]), np.array(c))[0]
        assert np.diff(near)[0] / (2 * small) == pytest.approx(slope, rel=1e-3)


def histories(accelerated, seed=0, assets=120, months=150):
    """Read a fleet of gamma processes, each failing once at most."""
    rng = np.random.default_rng(seed)
    rates = 0.1 * rng.lognormal(-0.045, 0.3, assets)
    belief, damage = drift.start((assets,), 0.12), np.zeros(assets)
    for _ in range(months):
        speed = 0.6 + 1.2 * damage if accelerated else 1.0
        damage = damage + speed * rng.gamma(rates / 12 / 0.01, 0.01)
        alive = damage < 1.0
        belief = drift.advance(belief, 1 / 12)
        reading = np.where(alive, damage + 0.04 * rng.standard_normal(assets), np.nan)
        belief = drift.read(belief, reading, 0.04)
    return drift.pool(belief, 0.12, 0.06), rates, damage


def test_sisters_tell_rate_spread_and_variance():
    pooled, rates, _ = histories(accelerated=False)
    assert float(pooled.acceleration) == 0.0
    assert float(pooled.mean_rate) == pytest.approx(rates.mean(), rel=0.1)
    assert float(pooled.variance) == pytest.approx(0.1 * 0.01, rel=0.5)
    z = (pooled.rate - rates) / np.sqrt(pooled.prr)
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_damage_that_grows_faster_is_recognised():
    pooled, _, _ = histories(accelerated=True)
    assert float(pooled.acceleration) > 0.0


def test_failures_ahead_of_a_known_rate_are_those_of_a_gamma_process():
    none = np.zeros(1)
    pooled = drift.Pooled(
        np.array([0.3]), np.array([0.1]), none, none, none, np.array(0.002), np.array(0.0),
        np.array(0.1), np.array(0.02),
    )  # fmt: skip
    time = np.array([0.0, 2.0, 5.0, 8.0])
    place, rate = np.array([[0.3]]), np.array([[0.1]])
    found = drift.failure_cdf(pooled, place, rate, time)[0, 0]
    shape, scale = 0.1 * time[1:] / 0.02, 0.02
    np.testing.assert_allclose(found[1:], special.gammaincc(shape, 0.7 / scale), rtol=1e-9)
    assert found[0] == 0.0
