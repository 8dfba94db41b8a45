"""Which jumps a history has: found by scores, none where there is none, at little cost."""

import numpy as np
import pytest

from slowtime.estimation.filtering import Passes
from slowtime.evolution.events import jump_selection
from slowtime.evolution.forecasting import forecast, parameter_posterior
from slowtime.evolution.forecasting.outlook import JumpLaw
from slowtime.evolution.life import threshold_crossing

COUNT, SD = 400, 0.01
TIME = np.arange(float(COUNT))


def history(seed, count, sizes: tuple[float, float] = (5.0, 9.0)):
    """A drifting history with so many jumps, at least nine readings apart."""
    rng = np.random.default_rng([71, seed])
    gaps = rng.exponential(size=count + 1)
    at = np.cumsum(9 + (COUNT - 9 * (count + 1)) * gaps / gaps.sum())[:count].astype(int)
    steps = rng.choice([-1.0, 1.0], count) * rng.uniform(sizes[0], sizes[1], count) * SD
    truth = -1e-4 * TIME + (steps * (TIME[:, None] >= at)).sum(axis=1)
    return truth + SD * rng.standard_normal(COUNT), at, steps


def found_in(value, **more):
    outlook = forecast.fit(TIME[: len(value)], value, np.full(len(value), SD), **more)
    return np.array([round(at) + 1 for at, _ in outlook.jumps], dtype=int)


@pytest.mark.parametrize("seed", range(4))
def test_twenty_jumps_are_found_where_they_are(seed):
    value, at, _ = history(seed, 20)
    found = found_in(value)
    apart = np.abs(found[:, None] - at)
    assert (apart.min(axis=0) <= 2).sum() >= 18
    assert (apart.min(axis=1) <= 2).all()


def test_twenty_jumps_are_learnt_from_few_more_likelihoods_than_none(monkeypatch):
    """Jumps that are only tried are scored; no process is learnt for them."""
    learnt: list[None] = []
    plain = parameter_posterior.learn_parameters

    def counted(likelihood, *arguments, **more):
        learnt.append(None)
        return plain(likelihood, *arguments, **more)

    monkeypatch.setattr(forecast, "learn_parameters", counted)
    spent = []
    for count in (0, 20):
        value, _, _ = history(1, count)
        learnt.clear()
        found_in(value)
        spent.append(len(learnt))
    assert spent[0] == 1
    assert spent[1] <= 3


def ou(rng):
    path, keep = np.zeros(COUNT), np.exp(-1 / 20)
    for k in range(1, COUNT):
        path[k] = keep * path[k - 1] + 0.03 * np.sqrt(1 - keep**2) * rng.standard_normal()
    return path


SMOOTH = {
    "noise": lambda rng: np.zeros(COUNT),
    "drift and wave": lambda rng: -2e-4 * TIME + 0.03 * np.sin(TIME / 60 + rng.uniform(0, 6)),
    "bend": lambda rng: -0.2 * (TIME / COUNT) ** rng.uniform(1.5, 4.0),
    "random walk": lambda rng: np.cumsum(0.005 * rng.standard_normal(COUNT)),
    "short memory": ou,
}


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("tails", ["gaussian", "t4"])
def test_what_does_not_jump_has_no_jumps(name, tails):
    told = 0
    for seed in range(3):
        rng = np.random.default_rng([72, seed])
        truth = SMOOTH[name](rng)
        noise = rng.standard_normal(COUNT)
        if tails == "t4":
            noise = rng.standard_t(4, COUNT) / np.sqrt(2.0)
        told += len(found_in(truth + SD * noise, process="smooth"))
    assert told == 0


def test_no_shift_is_scored_twice_with_the_same_readings_and_jumps(monkeypatch):
    asked = []
    complete = Passes.interventions

    def noted(self, value, sd, *, jumps=()):
        asked.append((id(self), np.asarray(value).tobytes(), tuple(jumps)))
        return complete(self, value, sd, jumps=jumps)

    monkeypatch.setattr(Passes, "interventions", noted)
    time, rng = np.arange(200.0), np.random.default_rng(4)
    value = 0.08 * (time > 90) - 0.07 * (time > 140) + 0.01 * rng.standard_normal(200)
    found = forecast.fit(time, value, np.full(200, 0.01))
    assert [since for since, _ in found.jumps] == [90.0, 140.0]
    # The number of a pass may be given again once it is gone: neighbours are compared.
    latest = [asked[max(k - 2, 0) : k] for k in range(len(asked))]
    assert len(asked) > 10
    assert not any(one in before for one, before in zip(asked, latest, strict=True))


def test_outliers_are_no_jumps():
    value, _, _ = history(5, 0)
    value[[60, 61, 200, 330]] += [0.1, 0.12, -0.2, 0.15]
    assert len(found_in(value, process="smooth")) == 0


def test_what_somebody_has_seen_is_taken_as_soon_as_few_readings_show_it():
    rng = np.random.default_rng(73)
    value = SD * rng.standard_normal(63) + 0.08 * (np.arange(63) >= 60)
    assert found_in(value, process="smooth", suspected=[59.0]).tolist() == [60]
    quiet = SD * rng.standard_normal(63)
    assert found_in(quiet, process="smooth", suspected=[59.0]).tolist() == []


def test_jumps_of_any_number_are_penalised_by_their_places():
    assert jump_selection.log_prior_odds(100, 0) == 0.0
    assert jump_selection.log_prior_odds(100, 1) == pytest.approx(np.log(100.0 * 100))
    assert jump_selection.log_prior_odds(100, 2) == pytest.approx(np.log(100.0 * 100 * 99 / 2))


def test_jumps_that_come_back_are_told_from_those_at_random():
    value, at, _ = history(2, 12)
    scored = jump_selection.ScoredHistory(TIME, value, np.full(COUNT, SD), 0.1)
    assert jump_selection.regularity(scored, tuple(at.tolist())) < 0.8
    teeth = 0.1 * (TIME % 37.0 < 18.0) + SD * np.random.default_rng(3).standard_normal(COUNT)
    edges = np.flatnonzero(np.abs(np.diff(0.1 * (TIME % 37.0 < 18.0))) > 0.05) + 1
    scored = jump_selection.ScoredHistory(TIME, teeth, np.full(COUNT, SD), 0.1)
    assert jump_selection.regularity(scored, tuple(edges.tolist())) > 0.95


@pytest.mark.parametrize("seed", range(3))
def test_a_single_jump_is_no_tooth_however_large_it_is(seed):
    """Teeth of which a history holds two edges have jumped twice."""
    value, at, _ = history(seed, 1, sizes=(6.0, 10.0))
    outlook = forecast.fit(TIME, value, np.full(COUNT, SD))
    assert [abs(round(since) + 1 - at[0]) <= 2 for since, _ in outlook.jumps] == [True]
    assert outlook.period is None


@pytest.mark.long
@pytest.mark.parametrize("signs", [(-1.0, 1.0), (-1.0,)], ids=["both ways", "one way"])
def test_bands_hold_jumps_that_go_on_as_they_came(signs):
    """Known jumps leave a calm process, whose bands must not forget that more will come."""
    held, count = [], 500
    time = np.arange(float(count))
    for seed in range(12):
        rng = np.random.default_rng([74, seed])
        at = np.sort(rng.choice(np.arange(5, count), 12, replace=False))
        steps = rng.choice(signs, 12) * rng.uniform(5.0, 9.0, 12) * SD
        truth = (steps * (time[:, None] >= at)).sum(axis=1)
        value = truth + SD * rng.standard_normal(count)
        past = time[:COUNT], value[:COUNT], np.full(COUNT, SD)
        ahead = forecast.forecast(*past, time[COUNT:])
        held.append(((ahead.lo <= truth[COUNT:]) & (truth[COUNT:] <= ahead.hi)).mean())
    assert np.mean(held) > 0.85


def test_what_further_jumps_add_has_the_moments_of_what_is_drawn():
    law = JumpLaw(rate=0.05, mean=-0.3, sd=0.2, count=8)
    later = np.linspace(10.0, 60.0, 6)
    drawn = threshold_crossing._jumps(law, later, 20_000, 0)
    mean, variance, none, number = law.moments(later - later[0])
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.02)
    np.testing.assert_allclose(drawn.var(axis=0), variance, rtol=0.05, atol=1e-12)
    np.testing.assert_allclose((drawn == 0.0).mean(axis=0), none, atol=0.02)
    np.testing.assert_allclose(number[1:] * (1.0 - none[1:]), 0.05 * (later - 10.0)[1:])
