"""What laws learn, against brute force over their parameters and against their true values."""

import numpy as np
import pytest
from scipy import stats

from slowtime import degradation
from slowtime.degradation import STANDARD, CurveLaw, FleetPrior, KnownChange, pooled
from slowtime.degradation.curve_posterior import NOMINAL_SD, _solve, coefficient_prior
from slowtime.degradation.curves import (
    FADE,
    LINEAR,
    POWER,
    RUNAWAY,
    Curve,
    columns,
    crack,
    edge_flexibility,
)
from slowtime.degradation.gamma_process import GammaLaw
from slowtime.degradation.history import LEVEL_WIDTH, history_of
from slowtime.degradation.wiener import NODES, SIGMA, WIDTH, WienerLaw

TIME = np.linspace(0.0, 100.0, 50)


def readings(truth, sd=0.01, seed=0):
    noise = np.random.default_rng(seed).standard_normal(len(truth))
    return TIME, truth + sd * noise, np.full(len(truth), sd)


def test_the_evidence_of_a_straight_line_is_the_density_of_a_gaussian_vector():
    history = history_of(*readings(-0.002 * TIME))
    wide = LEVEL_WIDTH * history.scatter
    s = TIME / 100.0
    covariance = wide**2 * (1.0 + np.outer(s, s)) + np.diag(history.sd**2)
    exact = stats.multivariate_normal.logpdf(
        history.value, np.full(50, history.centre), covariance
    )
    assert CurveLaw(LINEAR).learn(history).log_evidence == pytest.approx(exact, abs=1e-6)


def test_noise_that_laws_overflow_on_is_learnt_from_all_the_same():
    value = [
        0.0186, -0.0433, -0.0272, -0.0348, -0.0115, 0.0168, 0.0468, 0.0284, 0.0235, -0.0185,
        0.0063, 0.0233, 0.0101, 0.0059, -0.0511, -0.0058, 0.0343, 0.0177, -0.0001, -0.0221,
        0.024, 0.0117, -0.0599,
    ]  # fmt: skip
    posterior = CurveLaw(RUNAWAY).learn(
        history_of(np.arange(23.0), np.array(value), np.full(23, 0.025))
    )
    assert np.isfinite(posterior.log_evidence)


def test_the_evidence_of_a_fade_is_the_integral_over_its_rate():
    history = history_of(*readings(np.exp(-0.004 * TIME) - 1.0))
    rates = np.linspace(-3.0, 3.0, 6001)
    wide = LEVEL_WIDTH * history.scatter
    logs = []
    for u in rates:
        column = np.exp(-2.0 * u * TIME / 100.0)
        covariance = wide**2 * np.outer(column, column) + np.diag(history.sd**2) + NOMINAL_SD**2
        factor = np.linalg.cholesky(covariance)
        away = np.linalg.solve(factor, history.value + 1.0 - (1.0 + history.centre) * column)
        logs.append(-0.5 * away @ away - np.log(np.diag(factor)).sum() - 25 * np.log(2 * np.pi))
    density = np.exp(np.array(logs) - max(logs)) * stats.norm.pdf(rates)
    exact = max(logs) + np.log(np.trapezoid(density, rates))
    assert CurveLaw(FADE).learn(history).log_evidence == pytest.approx(exact, abs=0.05)


def test_the_evidence_of_a_wiener_process_is_the_sum_over_gaussian_vectors():
    history = history_of(*readings(-0.002 * TIME))
    wide, logs = LEVEL_WIDTH * history.scatter, []
    normal = np.linspace(-2.8, 2.8, NODES)
    for u in normal:
        sigma = SIGMA * history.scatter * np.exp(WIDTH * u) / 10.0
        covariance = wide**2 * (1.0 + np.outer(TIME, TIME) / 1e4) + np.diag(history.sd**2)
        covariance += sigma**2 * np.minimum.outer(TIME, TIME)
        logs.append(
            stats.multivariate_normal.logpdf(
                history.value, np.full(50, history.centre), covariance
            )
        )
    prior = np.exp(-0.5 * normal**2)
    exact = np.log(np.sum(prior / prior.sum() * np.exp(np.array(logs) - max(logs)))) + max(logs)
    assert WienerLaw().learn(history).log_evidence == pytest.approx(exact, abs=1e-6)


def test_the_grid_of_a_gamma_process_says_what_a_particle_filter_says():
    rng = np.random.default_rng(4)
    truth = -np.cumsum(rng.gamma(0.6, 0.01, 50))
    history = history_of(*readings(truth, sd=0.03))
    (part,) = GammaLaw().learn(history).parts
    best = int(part.log_likelihood.argmax())
    rate, theta = np.exp(part.sample.points[best])
    from slowtime.degradation.gamma_process import _thinned

    thinned = _thinned(history)
    count = 20_000
    level = -thinned.value[0] + thinned.sd[0] * rng.standard_normal(count)
    total, wide = 0.0, LEVEL_WIDTH * history.scatter
    prior = stats.norm.logpdf(thinned.value[0], history.centre, wide)
    for k in range(1, len(thinned.time)):
        level += rng.gamma(rate / theta * (thinned.time[k] - thinned.time[k - 1]), theta, count)
        weight = stats.norm.pdf(-thinned.value[k], level, thinned.sd[k])
        total += np.log(weight.mean())
        level = rng.choice(level, count, p=weight / weight.sum())
    expected = prior + total + thinned.log_within
    assert part.log_likelihood[best] == pytest.approx(expected, abs=0.5)


def test_portions_of_any_size_lead_to_the_same_numbers():
    time, value, sd = readings(-0.002 * TIME)
    begun = degradation.learn(time[:30], value[:30], sd[:30])
    at_once = begun.follow(time[30:], value[30:], sd[30:])
    one_by_one = begun
    for k in range(30, 50):
        one_by_one = one_by_one.follow(time[k : k + 1], value[k : k + 1], sd[k : k + 1])
    assert at_once.weights == one_by_one.weights
    paths = [one.futures(200.0, paths=200).paths for one in (at_once, one_by_one)]
    np.testing.assert_array_equal(paths[0], paths[1])


def test_laws_that_follow_agree_with_laws_that_learn_all_at_once():
    time, value, sd = readings(-0.002 * TIME)
    followed = degradation.learn(time[:40], value[:40], sd[:40]).follow(
        time[40:], value[40:], sd[40:]
    )
    whole = degradation.learn(time, value, sd)
    lives = [one.remaining_life(-0.3, 300.0) for one in (followed, whole)]
    assert lives[0].median == pytest.approx(lives[1].median, rel=0.05)


def test_no_path_is_below_the_physical_bound_and_thresholds_above_it_stay():
    mixture = degradation.learn(*readings(-0.008 * TIME, sd=0.05))
    free = degradation.learn(*readings(-0.008 * TIME, sd=0.05), bound=-np.inf)
    bounded, other = (one.futures(400.0, paths=500) for one in (mixture, free))
    assert bounded.paths.min() == -1.0
    assert other.paths.min() < -1.0
    smooth = bounded.roughness == 0.0
    times = [one.failure_time(-0.95, toward="below")[smooth] for one in (bounded, other)]
    np.testing.assert_array_equal(np.isfinite(times[0]), np.isfinite(times[1]))


def test_a_jump_that_is_told_leaves_the_drift_as_it_is():
    truth = -0.002 * TIME + np.where(TIME > 52.0, 0.15, 0.0)
    told = history_of(*readings(truth), events=[KnownChange(52.0, sd=0.3)])
    drift = CurveLaw(LINEAR).learn(told).hyperparameters()
    assert drift is not None
    assert drift.mean[0] == pytest.approx(-0.002, abs=3 * drift.covariance[0, 0] ** 0.5)
    assert drift.covariance[0, 0] ** 0.5 < 2e-4


@pytest.mark.parametrize("restored", [0.5, 1.0])
def test_a_repair_takes_age_away(restored):
    age = np.where(TIME > 52.0, TIME - restored * 52.0, TIME)
    history = history_of(*readings(-0.002 * age), events=[KnownChange(52.0, restored=restored)])
    np.testing.assert_allclose(history.age(TIME), age / 100.0)
    posterior = CurveLaw(LINEAR).learn(history)
    later = np.array([100.0, 150.0])
    paths = posterior.draw(later, 400, np.random.default_rng(0)).paths
    line = np.polyfit(age, history.value, 1)  # least squares over the true age
    expected = np.polyval(line, later - restored * 52.0)
    np.testing.assert_allclose(np.median(paths, axis=0), expected, atol=2e-3)


def test_sisters_narrow_what_few_readings_leave_open():
    sisters = []
    for seed in range(6):
        slope = -0.002 * (1.0 + 0.05 * np.random.default_rng(seed).standard_normal())
        mixture = degradation.learn(*readings(slope * TIME, seed=seed))
        sisters.append(mixture.hyperparameters()["linear drift"])
    fleet = pooled(sisters)
    assert fleet is not None
    few = (
        TIME[:8],
        -0.002 * TIME[:8] + 0.01 * np.random.default_rng(9).standard_normal(8),
        np.full(8, 0.01),
    )
    lives = [
        degradation.learn(*few, laws=[CurveLaw(LINEAR)], fleet=one).remaining_life(-0.2, 1000.0)
        for one in (None, {"linear drift": fleet})
    ]
    widths = [float(np.ptp(one.quantile(np.array([0.1, 0.9])))) for one in lives]
    assert widths[1] < 0.5 * widths[0]
    assert lives[1].median == pytest.approx(100.0, rel=0.2)
    assert pooled(sisters[:2]) is None
    with pytest.raises(ValueError, match="different laws"):
        pooled([sisters[0], FleetPrior("Wiener", np.zeros(1), np.eye(1))])


def test_a_law_of_ones_own_wins_where_it_is_the_true_one():
    def wave(points, age):
        return np.sin((4.0 + points[:, :1]) * age)

    own = CurveLaw(Curve("wave", wave, ("pulsation",)))
    laws = [own, CurveLaw(LINEAR), CurveLaw(POWER)]
    mixture = degradation.learn(*readings(0.1 * np.sin(4.0 * TIME / 100.0)), laws=laws)
    assert mixture.weights["wave"] > 0.99
    assert mixture.warning is None


def test_readings_that_no_law_explains_are_told():
    jagged = np.where(np.arange(50) % 2 == 0, 0.1, -0.1)
    mixture = degradation.learn(*readings(jagged, sd=0.01), laws=[CurveLaw(LINEAR)])
    assert mixture.p_value < 1e-3
    assert mixture.warning is not None
    assert "Check the standard deviations" in mixture.warning


def test_a_crack_grows_by_the_closed_form_of_its_law():
    points = np.zeros((1, 4))
    age = np.linspace(0.0, 1.0, 2001)
    first, end, exponent = 0.08, 2.2, 3.2
    depth = np.empty(len(age))
    depth[0] = first
    # da/ds = C a^(m/2), with C such that the crack is infinite at `end`.
    pace = first ** (1.0 - exponent / 2.0) / ((exponent / 2.0 - 1.0) * end)
    for k in range(len(age) - 1):
        half = depth[k] + 0.5 * (age[1]) * pace * depth[k] ** (exponent / 2.0)
        depth[k + 1] = depth[k] + age[1] * pace * half ** (exponent / 2.0)
    flexible = 0.5 * edge_flexibility(depth)
    np.testing.assert_allclose(crack(points, age)[0], flexible / (1.0 + flexible), rtol=1e-5)


def test_the_flexibility_of_an_edge_crack_gives_back_its_stress_intensity():
    """A crack releases energy as it grows: V' = 3 pi a F(a)^2, with K = s F sqrt(pi a)."""
    depth = np.linspace(0.05, 0.7, 14)
    slope = (edge_flexibility(depth + 1e-4) - edge_flexibility(depth - 1e-4)) / 2e-4
    half = 0.5 * np.pi * depth
    intensity = np.sqrt(np.tan(half) / half) * (0.923 + 0.199 * (1 - np.sin(half)) ** 4)
    released = 3.0 * np.pi * depth * (intensity / np.cos(half)) ** 2
    np.testing.assert_allclose(slope, released, rtol=0.07)  # both are fits of numbers


def test_bad_input_says_what_to_do():
    with pytest.raises(ValueError, match="too few to learn"):
        degradation.learn(TIME[:3], TIME[:3], TIME[:3])
    with pytest.raises(ValueError, match="after the first reading"):
        degradation.learn(*readings(-0.002 * TIME), origin=5.0)
    with pytest.raises(ValueError, match="is not a valid event"):
        KnownChange(1.0, restored=1.2)
    mixture = degradation.learn(*readings(-0.002 * TIME), laws=[CurveLaw(LINEAR)])
    with pytest.raises(ValueError, match="not after the last reading"):
        mixture.futures(50.0)
    with pytest.raises(ValueError, match="Learn anew"):
        mixture.follow(TIME[:1], TIME[:1], np.ones(1))


@pytest.mark.long
def test_hidden_histories_are_held_and_scored_better_than_by_gaussian_processes():
    from tests.slowtime.degradation import battery
    from tests.slowtime.degradation.histories import KINDS

    scores = [
        score for kind in KINDS for score in map(battery.judge, battery.cases(kind, 10, 3))
    ]
    held = np.mean([battery.holds(one.ours) for one in scores])
    print(battery.line("pooled", scores))
    assert 0.8 - 3 * 0.052 <= held <= 0.8 + 3 * 0.052
    ours, today = (
        np.mean([battery.pinball(getattr(one, who)) for one in scores])
        for who in ("ours", "today")
    )
    assert ours < today
    assert all(np.isfinite(one.ours[1]) for one in scores if one.within >= 0.5)


@pytest.mark.parametrize(
    ("former", "name"), [("Law", "DegradationLaw"), ("Event", "KnownChange")]
)
def test_former_names_work_and_warn(former, name):
    with pytest.warns(DeprecationWarning, match=name):
        assert getattr(degradation, former) is getattr(degradation, name)
    assert not hasattr(degradation, former + "s")


@pytest.mark.parametrize("law", [one for one in STANDARD if isinstance(one, CurveLaw)])
def test_no_shape_however_far_out_is_likelier_than_a_perfect_fit(law):
    """A shape in the tails of a proposal grows by many orders of magnitude in a history."""
    rng = np.random.default_rng(3)
    time = np.arange(60.0)
    sd = np.full(60, 0.003)
    value = -0.1 + 0.01 * np.cumsum(rng.standard_normal(60))
    history = history_of(time, value, sd)
    size = len(law.curve.names)
    points = rng.standard_normal((200, size)) * np.linspace(1.0, 12.0, 200)[:, None]
    if law.curve.broken is not None:
        points = rng.random((200, 1))
    prior = coefficient_prior(law.curve, history, None)
    with np.errstate(all="ignore"):
        solved = _solve(law.curve, history, points, *prior)
    best = -0.5 * np.log(2.0 * np.pi * history.sd**2).sum()
    assert not np.any(solved.log_likelihood > best)
    # Near the middle it is the density of the readings with the coefficients integrated out.
    near = points[:1]
    design = columns(law.curve, near, history.age(history.time))[0]
    spread = design @ prior[1] @ design.T + np.diag(history.sd**2)
    target = history.value + (1.0 if law.curve.fades else 0.0)
    dense = stats.multivariate_normal(design @ prior[0], spread).logpdf(target)
    assert solved.log_likelihood[0] == pytest.approx(dense, rel=1e-6, abs=1e-3)
