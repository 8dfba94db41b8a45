import numpy as np
import pytest

from slowtime.dynamics.evolution_functions import mass_change
from slowtime.estimation import filtering
from slowtime.estimation.matern import SlowProcess
from slowtime.evolution.forecasting import forecast
from tests.slowtime.estimation.matern_correlation import matern_correlation

TIME = np.linspace(0, 1000, 126)
PAST = TIME <= 800


def matern_path(rng, smoothness, length, sd):
    k = sd**2 * matern_correlation(smoothness, (TIME[:, None] - TIME) / length)
    root = np.linalg.cholesky(k + 1e-10 * sd**2 * np.eye(len(TIME)))
    return root @ rng.standard_normal(len(TIME))


HISTORIES = {
    "line with wiggles": lambda rng: -1e-4 * TIME + matern_path(rng, 1.5, 60.0, 0.01),
    "rough and stationary": lambda rng: matern_path(rng, 0.5, 100.0, 0.02),
    "smooth and stationary": lambda rng: matern_path(rng, 2.5, 150.0, 0.03),
    "wandering slope": lambda rng: np.cumsum(np.cumsum(1e-4 * rng.standard_normal(126))),
    "random walk": lambda rng: np.cumsum(3e-3 * rng.standard_normal(126)),
}


def covered(make, seed, runs):
    rng = np.random.default_rng(seed)
    inside = []
    for _ in range(runs):
        truth = make(rng)
        sd = rng.uniform(0.003, 0.01, len(TIME))
        value = truth + sd * rng.standard_normal(len(TIME))
        found = forecast.forecast(TIME[PAST], value[PAST], sd[PAST], TIME[~PAST])
        inside.append((found.lo <= truth[~PAST]) & (truth[~PAST] <= found.hi))
    return np.mean(inside)


@pytest.mark.slow
def test_pooled_over_unlike_histories_the_bands_cover_what_came():
    share = np.mean([covered(make, 91, 8) for make in HISTORIES.values()])
    assert 0.90 <= share <= 0.98


@pytest.mark.slow
@pytest.mark.parametrize("name", HISTORIES)
def test_the_bands_cover_each_kind_of_history(name):
    assert 0.88 <= covered(HISTORIES[name], 92, 150) <= 0.985


@pytest.mark.long
def test_the_book_s_loss_of_stiffness_is_forecast_within_its_band():
    truth = np.exp(-4e-4 * TIME) * (1 + 0.05 * np.cos(2e-2 * TIME)) / 1.05 - 1
    assert covered(lambda rng: truth, 93, 3) > 0.9


def test_the_weights_stand_for_the_posterior_over_all_processes():
    rng = np.random.default_rng(3)
    time = np.arange(15.0)
    sd = np.full(15, 0.1)
    value = 0.3 * np.sin(time / 6) + sd * rng.standard_normal(15)
    outlook = forecast.fit(time, value, sd)
    prior, base = forecast.prior_of(time, value)
    axes = [c + w * np.linspace(-4, 4, 29) for c, w in zip(prior.centre, prior.sd, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    family = forecast._members(base, outlook.family.smoothness, points)
    logs = filtering.log_likelihood(family, time, value, sd) + prior.log_density(points)
    grid = np.exp(logs - logs.max())
    grid /= grid.sum()
    for column, parameter in enumerate(("length", "sd", "slope_drift")):
        mean = grid @ points[:, column]
        spread = np.sqrt(grid @ (points[:, column] - mean) ** 2)
        found = np.log(getattr(outlook.family, parameter))
        found_mean = outlook.weights @ found
        assert abs(found_mean - mean) < 0.25 * spread
        assert np.sqrt(outlook.weights @ (found - found_mean) ** 2) == pytest.approx(
            spread, rel=0.08
        )


def test_the_variance_is_that_within_the_processes_and_that_between_their_means():
    """The law of total variance: processes that disagree make a forecast less certain."""
    time, later = np.arange(30.0), np.array([30.0, 45.0, 90.0])
    history = time, np.sin(time / 8.0), np.full(30, 0.02)
    weights = np.array([0.3, 0.7])
    lengths, sds = np.array([3.0, 40.0]), np.array([1.0, 1.0])

    def foretold(which, weights):
        family = SlowProcess(length=lengths[which], sd=sds[which], level_sd=1.0)
        return forecast.predict(forecast.Outlook(family, weights), *history, later)

    whole = foretold([0, 1], weights)
    alone = [foretold([i], np.ones(1)) for i in (0, 1)]
    means, spreads = (np.array([getattr(one, of) for one in alone]) for of in ("mean", "sd"))
    assert (np.abs(np.diff(means, axis=0)) > 0.05).any()
    between = weights @ (means - weights @ means) ** 2
    np.testing.assert_allclose(whole.mean, weights @ means, rtol=1e-9)
    np.testing.assert_allclose(whole.sd**2, weights @ spreads**2 + between, rtol=1e-9)


@pytest.mark.long
def test_jumps_to_come_scatter_as_those_that_were_did():
    rng = np.random.default_rng(8)
    time, sizes = np.arange(240.0), np.array([1.0, 3.0, 1.4, 2.6])
    after = np.searchsorted([31.0, 95.0, 140.0, 203.0], time)
    value = np.concatenate([[0.0], np.cumsum(sizes)])[after] + 0.02 * rng.standard_normal(240)
    further = forecast.fit(time, value, np.full(240, 0.02), process="smooth").further
    assert further is not None
    assert further.count == 4
    assert further.mean == pytest.approx(np.mean(sizes), rel=0.05)
    assert further.sd == pytest.approx(np.std(sizes, ddof=1), rel=0.1)


def test_the_band_widens_and_the_horizon_lies_ahead():
    rng = np.random.default_rng(94)
    value = matern_path(rng, 1.5, 60.0, 0.03)
    sd = np.full(len(TIME), 0.003)
    found = forecast.forecast(TIME, value, sd, np.linspace(1000, 2000, 30))
    assert (np.diff(found.sd) > 0).all()
    assert 1020 < found.horizon < 1150


def test_a_history_without_memory_has_no_horizon():
    rng = np.random.default_rng(95)
    sd = np.full(200, 0.02)
    found = forecast.forecast(
        np.arange(200.0), sd * rng.standard_normal(200), sd, np.array([220.0])
    )
    assert found.horizon < 199 + 30
    assert abs(found.mean[0]) < 0.01


@pytest.mark.parametrize(
    ("in_time", "in_value"), [(1e-3, 1.0), (3.6e3, 1.0), (1.0, 1e-4), (1.0, 1e6)]
)
def test_units_do_not_matter(in_time, in_value):
    rng = np.random.default_rng(96)
    time = np.sort(rng.uniform(0, 100, 60))
    value, sd = np.sin(time / 20) + 0.1 * rng.standard_normal(60), np.full(60, 0.1)
    later = np.array([101.0, 120.0])
    here = forecast.forecast(time, value, sd, later)
    there = forecast.forecast(time * in_time, value * in_value, sd * in_value, later * in_time)
    np.testing.assert_allclose(there.mean / in_value, here.mean, rtol=1e-5)
    np.testing.assert_allclose(there.sd / in_value, here.sd, rtol=1e-5)
    assert there.horizon / in_time == pytest.approx(here.horizon, rel=1e-5)


def test_order_gaps_and_missing_values_do_not_matter():
    rng = np.random.default_rng(97)
    time = np.concatenate([np.arange(30.0), np.arange(60.0, 90.0)])
    value, sd = 0.01 * time + 0.1 * rng.standard_normal(60), np.full(60, 0.1)
    whole = forecast.forecast(time, value, sd, np.array([100.0]))
    mix = rng.permutation(62)
    dirty_time = np.append(time, [5.0, np.nan])[mix]
    dirty_value = np.append(value, [np.nan, 0.0])[mix]
    dirty_sd = np.append(sd, [0.1, 0.1])[mix]
    again = forecast.forecast(dirty_time, dirty_value, dirty_sd, np.array([100.0]))
    assert again.mean[0] == pytest.approx(whole.mean[0], abs=1e-12)
    assert again.sd[0] == pytest.approx(whole.sd[0], abs=1e-12)


def test_exact_and_constant_histories_are_forecast_too():
    line = forecast.forecast(
        np.arange(20.0), 0.5 * np.arange(20.0), np.zeros(20), np.array([22.0])
    )
    assert line.mean[0] == pytest.approx(11.0, abs=0.05)
    flat = forecast.forecast(np.arange(20.0), np.full(20, 3.0), np.zeros(20), np.array([22.0]))
    assert flat.mean[0] == pytest.approx(3.0, abs=1e-6)


def test_teeth_of_what_is_known_to_repeat_itself_are_no_jumps():
    rng, count = np.random.default_rng(1), 400
    time = 500.0 + np.arange(count)
    sd = 0.013 * np.exp(0.4 * rng.standard_normal(count))
    sd[rng.integers(0, count, 4)] *= 6.0  # some readings are much less sure
    value = mass_change(time) + sd * rng.standard_normal(count)
    outlook = forecast.fit(time, value, sd, process="repeating")
    assert outlook.period == pytest.approx(2.0 * np.pi / 0.15, rel=0.01)
    assert outlook.jumps == ()


@pytest.mark.parametrize(
    "begin", [6100, *(pytest.param(b, marks=pytest.mark.long) for b in (6400, 7000))]
)
def test_edges_are_found_wherever_they_lie_between_readings(begin):
    """Nine edges fit between the right readings at few periods and phases: one is as good."""
    rng = np.random.default_rng(begin)
    time = begin + np.arange(400.0)

    def teeth(time):
        return 0.5 * ((time / 41.888 + 0.3) % 1.0) - 0.25

    sd = np.full(400, 0.007)
    value = teeth(time) + sd * rng.standard_normal(400)
    later = time[-1] + np.arange(1.0, 201.0)
    ahead = forecast.forecast(time, value, sd, later)
    assert np.median(ahead.hi - ahead.lo) < 8 * 0.007
    # Next to an edge either side of it is possible.
    assert np.median(np.abs(ahead.mean - teeth(later))) < 2 * 0.007


def test_the_past_is_not_forecast():
    history = np.arange(10.0), np.zeros(10), np.ones(10)
    with pytest.raises(ValueError, match="Ask for later times"):
        forecast.forecast(*history, np.array([8.0]))


def test_two_readings_are_no_history():
    with pytest.raises(ValueError, match="at least 3 readings"):
        forecast.forecast(np.arange(2.0), np.zeros(2), np.ones(2), np.array([8.0]))
