import pickle

import numpy as np
import pytest
from scipy import linalg

from slowtime.estimation import filtering, state_space
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import (
    Constant,
    Matern,
    Periodic,
    Trend,
    quasi_periodic,
)

PROCESSES = {
    "Matern 1/2": Matern(smoothness=0.5, length=4.0, sd=0.8),
    "Matern 3/2": Matern(smoothness=1.5, length=4.0, sd=0.8),
    "Matern 5/2": Matern(smoothness=2.5, length=4.0, sd=0.8),
    "periodic": Periodic(period=9.0, length=0.9, sd=0.7),
    "edged": Periodic(period=9.0, length=0.9, sd=0.7, harmonics=6, edges=True),
    "quasi-periodic": quasi_periodic(
        period=9.0, length=1.1, sd=0.7, memory=30.0, smoothness=1.5
    ),
    "sum": Matern(length=12.0, sd=1.0) + Matern(smoothness=0.5, length=2.0, sd=0.4),
    "sum with a level": Constant(sd=2.0) + Matern(smoothness=2.5, length=6.0, sd=0.5),
    "product": Matern(length=12.0, sd=1.0) * Periodic(period=6.0, length=1.4, sd=0.9),
    "sum of products": Constant(sd=1.0)
    + Matern(length=9.0, sd=0.5)
    + quasi_periodic(period=5.0, length=1.5, sd=0.7, memory=20.0),
}
EVERY = pytest.mark.parametrize("name", PROCESSES)


def series(seed, count):
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(5.0, 5.0 + 0.5 * count, count))
    sd = rng.uniform(0.05, 0.3, count)
    return time, np.sin(time / 5) + 0.3 * rng.standard_normal(count), sd


def dense(process, time, value, sd, at):
    def k(a, b):
        return process.covariance(a[:, None] - b)

    factor = linalg.cho_factor(k(time, time) + np.diag(sd**2), lower=True)
    cross = k(at, time)
    mean = cross @ linalg.cho_solve(factor, value)
    variance = np.diag(k(at, at) - cross @ linalg.cho_solve(factor, cross.T))
    volume = 2 * np.log(np.diag(factor[0])).sum() + len(time) * np.log(2 * np.pi)
    return mean, variance, -0.5 * (value @ linalg.cho_solve(factor, value) + volume)


@EVERY
def test_filtered_smoothed_and_foretold_it_is_the_dense_process(name):
    process = PROCESSES[name]
    time, value, sd = series(21, 60)
    at = np.array([6.0, 14.5, 30.2])
    merged = np.concatenate([time, at])
    order = np.argsort(merged)
    padded = np.append(value, np.full(3, np.nan))[order]
    found = filtering.smooth(process, merged[order], padded, np.append(sd, np.ones(3))[order])
    asked = np.isnan(padded)
    mean, variance, likelihood = dense(process, time, value, sd, np.sort(at))
    np.testing.assert_allclose(found.mean[asked], mean, atol=1e-8)
    np.testing.assert_allclose(found.sd[asked] ** 2, variance, atol=1e-8)
    assert filtering.log_likelihood(process, time, value, sd) == pytest.approx(
        likelihood, abs=1e-8
    )
    later = time[-1] + np.array([0.0, 0.7, 12.0, 90.0])
    belief = filtering.filtered(process, time, value, sd).belief
    mean, spread = state_space.predict(process, belief, later)
    expected, variance, _ = dense(process, time, value, sd, later)
    np.testing.assert_allclose(mean, expected, atol=1e-8)
    np.testing.assert_allclose(spread**2, variance, atol=1e-8)


@pytest.mark.parametrize("name", ["Matern 3/2", "sum of products"])
def test_each_reading_is_foretold_by_the_others_as_the_dense_process_does(name):
    process = PROCESSES[name]
    time, value, sd = series(30, 25)
    value[7] = np.nan
    mean, spread = filtering.leave_one_out(process, time, value, sd)
    for i in (0, 6, 7, 24):
        kept = np.isfinite(value) & (np.arange(25) != i)
        expected, variance, _ = dense(
            process, time[kept], value[kept], sd[kept], time[i : i + 1]
        )
        assert mean[i] == pytest.approx(expected[0], abs=1e-9)
        assert spread[i] ** 2 == pytest.approx(variance[0], abs=1e-9)


def peers():
    kernels = pytest.importorskip("sklearn.gaussian_process.kernels")
    c = kernels.ConstantKernel
    return {
        "Matern 1/2": c(0.64) * kernels.Matern(4.0, nu=0.5),
        "Matern 3/2": c(0.64) * kernels.Matern(4.0, nu=1.5),
        "Matern 5/2": c(0.64) * kernels.Matern(4.0, nu=2.5),
        "quasi-periodic": c(0.49)
        * kernels.ExpSineSquared(1.1, 9.0)
        * kernels.Matern(30.0, nu=1.5),
        "sum with a level": c(4.0) + c(0.25) * kernels.Matern(6.0, nu=2.5),
        "sum of products": c(1.0)
        + c(0.25) * kernels.Matern(9.0, nu=1.5)
        + c(0.49) * kernels.ExpSineSquared(1.5, 5.0) * kernels.Matern(20.0, nu=0.5),
    }


@pytest.mark.parametrize(
    "name",
    [
        "Matern 1/2",
        "Matern 3/2",
        "Matern 5/2",
        "quasi-periodic",
        "sum with a level",
        "sum of products",
    ],
)
def test_at_five_hundred_readings_it_is_scikit_learn_s_process_to_eight_digits(name):
    kernel = peers()[name]
    from sklearn.gaussian_process import GaussianProcessRegressor

    process = PROCESSES[name]
    time, value, sd = series(22, 500)
    peer = GaussianProcessRegressor(kernel, alpha=sd**2, optimizer=None)
    peer.fit(time[:, None], value)
    later = time[-1] + np.linspace(0.1, 40.0, 20)
    mean, spread = peer.predict(np.append(time, later)[:, None], return_std=True)
    smoothed = filtering.smooth(
        process,
        np.append(time, later),
        np.append(value, np.full(20, np.nan)),
        np.append(sd, np.ones(20)),
    )
    np.testing.assert_allclose(smoothed.mean, mean, atol=1e-8)
    np.testing.assert_allclose(smoothed.sd**2, spread**2, atol=1e-8)
    likelihood = filtering.log_likelihood(process, time, value, sd)
    assert likelihood == pytest.approx(peer.log_marginal_likelihood_value_, abs=1e-8)


def test_a_trend_that_wanders_is_that_of_the_slow_process():
    process = Trend(level_sd=3.0, slope_sd=0.5, drift=0.05) + Matern(length=4.0, sd=0.8)
    slow = SlowProcess(length=4.0, sd=0.8, level_sd=3.0, slope_sd=0.5, slope_drift=0.05)
    time, value, sd = series(24, 40)
    both = filtering.smooth(process, time, value, sd, part=process.part(0))
    level = np.array([1.0, 0.0, 0.0, 0.0])
    theirs = filtering.smooth(slow, time, value, sd, part=level)
    np.testing.assert_allclose(both, theirs, atol=1e-9)
    assert filtering.log_likelihood(process, time, value, sd) == pytest.approx(
        filtering.log_likelihood(slow, time, value, sd), abs=1e-9
    )


@EVERY
def test_a_family_is_each_of_its_members(name):
    process = PROCESSES[name]
    logs = process.logs + np.array([[0.0], [0.1], [-0.2]])
    time, value, sd = series(25, 12)
    if "periodic" in name or "products" in name:
        pytest.skip("members would have unlike numbers of harmonics")
    together = filtering.log_likelihood(process.at(logs), time, value, sd)
    for own, member in zip(together, logs, strict=True):
        assert own == pytest.approx(
            float(filtering.log_likelihood(process.at(member), time, value, sd))
        )


@EVERY
def test_a_stream_kept_on_disk_and_cut_anywhere_goes_on_the_same(name):
    process = PROCESSES[name]
    time, value, sd = series(26, 30)
    value[3] = np.nan
    whole = filtering.filtered(process, time, value, sd).belief
    belief = filtering.filtered(process, time[:17], value[:17], sd[:17]).belief
    belief = pickle.loads(pickle.dumps(belief))
    for t, y, s in zip(time[17:], value[17:], sd[17:], strict=True):
        belief, reading = state_space.step(process, belief, float(t), float(y), float(s))
        assert reading.variance > 0
    np.testing.assert_allclose(belief.mean, whole.mean, atol=1e-12)
    np.testing.assert_allclose(belief.covariance, whole.covariance, atol=1e-12)
    assert np.linalg.eigvalsh(belief.covariance).min() > -1e-12


def test_futures_drawn_have_the_moments_foretold():
    process = PROCESSES["sum"]
    time, value, sd = series(28, 20)
    belief = filtering.filtered(process, time, value, sd).belief
    later = time[-1] + np.array([1.0, 4.0, 9.0])
    mean, spread = state_space.predict(process, belief, later)
    shocks = np.random.default_rng(29).standard_normal((20_000, 4, process.size))
    paths = filtering.sample(process, belief, later, np.zeros(20_000, dtype=int), shocks)
    np.testing.assert_allclose(paths.mean(axis=0), mean, atol=0.03)
    np.testing.assert_allclose(paths.std(axis=0), spread, rtol=0.03)


def test_a_jump_lets_the_level_go_elsewhere():
    process = Constant(sd=10.0) + Matern(length=5.0, sd=0.1)
    time = np.arange(40.0)
    value = np.where(time > 19, 3.0, 0.0)
    sd = np.full(40, 0.05)
    told = filtering.smooth(process, time, value, sd, jumps=[(19.0, 10.0)])
    assert told.mean[19] == pytest.approx(0.0, abs=0.06)
    assert told.mean[20] == pytest.approx(3.0, abs=0.06)
    untold = filtering.smooth(process, time, value, sd)
    assert abs(untold.mean[20] - 3.0) > 0.3


@pytest.mark.parametrize(
    ("make", "cure"),
    [
        (lambda: Matern(length=-1.0, sd=1.0), "finite number above 0"),
        (lambda: Matern(smoothness=1.0, length=1.0, sd=1.0), "Give 1.5 when unsure"),
        (lambda: Matern(length=1.0, sd=1.0) * Trend(level_sd=1.0, slope_sd=1.0), "add the tre"),
        (lambda: Periodic(period=1.0, length=1e-5, sd=1.0).count, "above 0.001"),
    ],
)
def test_what_is_no_process_is_refused_with_the_cure(make, cure):
    with pytest.raises(ValueError, match=cure):
        make()


def test_time_going_back_is_refused():
    process = PROCESSES["sum"]
    with pytest.raises(ValueError, match="ascending order"):
        state_space.step(process, process.start(3.0), 2.0, 0.0, 0.1)


@EVERY
def test_step_by_step_it_is_the_whole_series_and_a_family_of_one(name):
    process = PROCESSES[name]
    time, value, sd = series(33, 40)
    time[17], value[9] = time[16], np.nan
    belief = process.start(float(time[0]))
    one = process.at(process.logs[None])
    family = one.start(float(time[0]))
    for t, y, s in zip(time.tolist(), value.tolist(), sd.tolist(), strict=True):
        belief, read = state_space.step(process, belief, t, y, s)
        family, also = state_space.step(one, family, t, y, s)
        assert read.log_likelihood == pytest.approx(
            float(np.ravel(also.log_likelihood)[0]), abs=1e-9
        )
        assert read.spread == pytest.approx(float(np.ravel(also.spread)[0]), abs=1e-9)
    whole = filtering.filtered(process, time, value, sd).belief
    for found in (whole.mean, family.mean[0]):
        np.testing.assert_allclose(belief.mean, found, atol=1e-9)
    for found in (whole.covariance, family.covariance[0]):
        np.testing.assert_allclose(belief.covariance, found, atol=1e-9)
    assert np.linalg.eigvalsh(belief.covariance).min() > -1e-12
