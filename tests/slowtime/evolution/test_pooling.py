"""Pooled drift rates: coverage over simulated fleets, limits, and an independent sampler."""

import math

import numpy as np
import pytest

from slowtime.evolution.pooling import drift_rate, pool


def fleet(rng, members, spread, sds):
    truth = -1.0 + spread * rng.standard_normal(members)
    return truth, truth + sds * rng.standard_normal(members)


LONG = pytest.mark.long


@pytest.mark.parametrize(
    "members", [pytest.param(4, marks=LONG), 12, pytest.param(30, marks=LONG)]
)
@pytest.mark.parametrize("spread", [0.0, 0.3, 1.0, 3.0])
def test_intervals_hold_over_simulated_fleets(members, spread):
    rng = np.random.default_rng(members)
    held = np.zeros(3)
    error = np.zeros(2)
    runs = 100
    for _ in range(runs):
        sds = rng.uniform(0.2, 1.0, members)
        truth, rates = fleet(rng, members, spread, sds)
        found = pool(rates, sds)
        new = -1.0 + spread * rng.standard_normal()
        held += (
            np.mean(
                [one.lo <= r <= one.hi for one, r in zip(found.members, truth, strict=True)]
            ),
            found.fleet.lo <= -1.0 <= found.fleet.hi,
            found.another.lo <= new <= found.another.hi,
        )
        pooled = np.array([one.value for one in found.members])
        error += np.sum((pooled - truth) ** 2), np.sum((rates - truth) ** 2)
    # Of 100 runs, 4 standard deviations of a share of 0.95 are 0.09.
    assert np.all(held / runs > 0.86)
    assert 0.92 < held[0] / runs
    assert spread == 0.0 or held[0] / runs < 0.985  # no spread is always overestimated
    # Pooling pays where rates are alike, and costs next to nothing where they are not.
    assert error[0] < (0.9 if spread < 0.5 else 1.05) * error[1]


def test_pooling_agrees_with_importance_sampling_from_the_prior():
    rates, sds = np.array([-1.2, -0.7, -1.6, -0.2, -1.0]), np.array([0.2, 0.4, 0.3, 0.5, 0.1])
    found = pool(rates, sds, spread_scale=0.8)
    rng = np.random.default_rng(0)
    tau = np.abs(0.8 * rng.standard_cauchy(400_000))
    mu = rng.uniform(-8.0, 6.0, tau.size)
    variance = sds**2 + tau[:, None] ** 2
    log = -0.5 * np.sum(np.log(variance) + (rates - mu[:, None]) ** 2 / variance, axis=1)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    share = sds**2 / variance
    own = weight @ ((1 - share) * rates + share * mu[:, None])
    sd = math.sqrt(weight @ (mu - weight @ mu) ** 2)
    assert found.fleet.value == pytest.approx(weight @ mu, abs=0.02)
    assert found.fleet.sd == pytest.approx(sd, rel=0.1)
    assert [one.value for one in found.members] == pytest.approx(own.tolist(), abs=0.02)


def test_much_data_leave_a_rate_alone_and_little_gives_it_to_the_fleet():
    rates = np.array([-1.0, -1.1, -0.9, -1.05, 4.0, 4.0])
    found = pool(rates, np.array([0.05, 0.05, 0.05, 0.05, 0.01, 50.0]))
    assert found.members[4].value == pytest.approx(4.0, abs=0.01)
    assert found.shrinkage[4] < 0.001
    assert found.shrinkage[5] > 0.99
    assert abs(found.members[5].value - found.fleet.value) < 0.1


def test_a_member_without_readings_gets_what_another_of_the_fleet_would_have():
    found = pool(np.array([-1.0, -1.2, -0.8, np.nan]), np.array([0.1, 0.1, 0.1, np.nan]))
    assert found.members[3] == found.another
    assert found.another.hi - found.another.lo > found.fleet.hi - found.fleet.lo


def test_one_member_has_an_interval_and_no_finite_standard_deviation_of_the_fleet():
    found = pool(np.array([-1.0]), np.array([0.1]))
    assert found.members[0].value == pytest.approx(-1.0)
    assert found.members[0].sd == pytest.approx(0.1, rel=1e-6)
    assert math.isinf(found.fleet.sd)
    assert math.isinf(found.another.sd)
    assert np.isfinite([found.another.lo, found.another.hi]).all()


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_the_slope_of_a_line_holds_its_interval_with_correlated_scatter(phi):
    rng = np.random.default_rng(3)
    time, held, runs = np.linspace(0.0, 50.0, 60), 0, 400
    for _ in range(runs):
        noise = rng.standard_normal(60)
        for i in range(1, 60):
            noise[i] = phi * noise[i - 1] + math.sqrt(1 - phi**2) * noise[i]
        found = drift_rate(time, 0.3 - 0.02 * time + 0.1 * noise, np.full(60, 0.1))
        assert found is not None
        slope, sd = found
        held += abs(slope + 0.02) < 1.959964 * sd
    assert 0.88 < held / runs < 0.99


def test_too_few_readings_have_no_rate_and_a_pool_needs_one():
    assert drift_rate(np.arange(3.0), np.zeros(3), np.ones(3)) is None
    assert drift_rate(np.zeros(9), np.zeros(9), np.ones(9)) is None
    with pytest.raises(ValueError, match="No member has a drift rate"):
        pool(np.array([np.nan]), np.array([np.nan]))
    with pytest.raises(ValueError, match="Give positive numbers"):
        pool(np.array([1.0]), np.array([0.0]))
