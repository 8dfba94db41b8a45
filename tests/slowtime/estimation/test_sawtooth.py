import numpy as np
import pytest

from slowtime.estimation import filtering, state_space
from slowtime.estimation.processes import Matern
from slowtime.estimation.sawtooth import Sawtooth

TEETH = Sawtooth(period=6.3, edge=2.1, sd=0.8, memory=40.0)
WHOLE = Matern(length=5.0, sd=0.3) + TEETH


def teeth(time, process=TEETH):
    return 2 * ((time - process.edge) / process.period % 1) - 1


def covariance(a, b):
    fading = 0.64 * np.exp(-np.abs(a[:, None] - b) / 40.0)
    return WHOLE.terms[0].covariance(a[:, None] - b) + fading * np.outer(teeth(a), teeth(b))


def series(count=40):
    rng = np.random.default_rng(61)
    time, sd = np.sort(rng.uniform(0.0, 30.0, count)), rng.uniform(0.05, 0.2, count)
    return time, 0.7 * teeth(time) + sd * rng.standard_normal(count), sd


def dense(time, value, sd, at):
    known = covariance(time, time) + np.diag(sd**2)
    cross = covariance(at, time)
    mean = cross @ np.linalg.solve(known, value)
    left = covariance(at, at) - cross @ np.linalg.solve(known, cross.T)
    likelihood = -0.5 * (
        value @ np.linalg.solve(known, value)
        + np.linalg.slogdet(known)[1]
        + len(time) * np.log(2 * np.pi)
    )
    return mean, np.sqrt(np.diag(left)), likelihood


def test_filtered_smoothed_and_foretold_it_is_the_dense_process():
    time, value, sd = series()
    later = np.linspace(30.5, 45.0, 12)
    belief = filtering.filtered(WHOLE, time, value, sd).belief
    mean, spread, likelihood = dense(time, value, sd, later)
    found = state_space.predict(WHOLE, belief, later)
    np.testing.assert_allclose(found, (mean, spread), atol=1e-9)
    assert float(filtering.log_likelihood(WHOLE, time, value, sd)) == pytest.approx(likelihood)
    smooth = filtering.smooth(WHOLE, time, value, sd)
    mean, spread, _ = dense(time, value, sd, time)
    np.testing.assert_allclose((smooth.mean, smooth.sd), (mean, spread), atol=1e-9)
    left_out = filtering.leave_one_out(WHOLE, time, value, sd)
    rest = np.delete(np.arange(40), 7)
    mean, spread, _ = dense(time[rest], value[rest], sd[rest], time[7:8])
    assert left_out[0][7] == pytest.approx(mean[0])
    assert left_out[1][7] == pytest.approx(spread[0])


def test_one_step_at_a_time_is_the_whole_series():
    time, value, sd = series()
    belief = WHOLE.start(float(time[0]))
    for reading in zip(time.tolist(), value.tolist(), sd.tolist(), strict=True):
        belief, _ = state_space.step(WHOLE, belief, *reading)
    whole = filtering.filtered(WHOLE, time, value, sd).belief
    np.testing.assert_allclose(belief.mean, whole.mean, atol=1e-12)


def test_a_family_is_each_of_its_members_and_futures_fall_at_the_edges():
    family = Matern(length=5.0, sd=0.3) + Sawtooth(
        period=np.array([6.3, 5.0]), edge=np.array([2.1, 1.0]), sd=0.8, memory=np.full(2, 40.0)
    )
    time, value, sd = series(20)
    together = filtering.log_likelihood(family, time, value, sd)
    for i, own in enumerate(together):
        member = family.member(i)
        assert own == pytest.approx(float(filtering.log_likelihood(member, time, value, sd)))
    belief = filtering.filtered(WHOLE, time, value, sd).belief
    later = np.array([30.5, 33.5, 33.7, 36.0])
    mean, spread = state_space.predict(WHOLE, belief, later)
    assert mean[2] < mean[1] - 0.5
    shocks = np.random.default_rng(62).standard_normal((8000, 5, WHOLE.size))
    paths = filtering.sample(WHOLE, belief, later, np.zeros(8000, dtype=int), shocks)
    np.testing.assert_allclose(paths.mean(axis=0), mean, atol=0.04)
    np.testing.assert_allclose(paths.std(axis=0), spread, rtol=0.05)
