"""Simulation-based calibration: true failure times rank evenly among those foretold.

Parameters are drawn from the prior of a law, a path and readings from the parameters, and only
assets that have survived are kept. The rank of the true failure time among sampled ones is then
uniform where forecasts condition rightly on readings and on survival (Talts et al., 2018).
"""

import numpy as np
import pytest
from scipy import stats

from slowtime.degradation.gamma_process import THETA_CENTRE, THETA_WIDTH, GammaLaw
from slowtime.degradation.history import LEVEL_WIDTH, History
from slowtime.degradation.survival import surviving_futures
from slowtime.degradation.wiener import SIGMA, WIDTH
from slowtime.evolution.life.first_passage import first_passage

RUNS, DRAWS = 500, 199
LIMIT = 4.0
"""Distance of the threshold from the prior mean of the first level, in scatters."""

FINE = 40
"""Steps of the true path between two readings."""


def history_of(time, value, sd):
    """Readings whose scales are those of the prior and not of the readings."""
    return History(time, value, sd, (), float(time[0]), float(time[-1] - time[0]), 0.0, 1.0)


def wiener_asset(rng):
    """A true path, in damage; readings on the first half; its failure time, if it survived."""
    fine = np.linspace(0.0, 3.0, 3 * 15 * FINE + 1)
    sigma = SIGMA * np.exp(WIDTH * stats.truncnorm.rvs(-2.8, 2.8, random_state=rng))
    drift = LEVEL_WIDTH * rng.standard_normal()
    steps = sigma * np.sqrt(fine[1]) * rng.standard_normal(len(fine) - 1)
    path = LEVEL_WIDTH * rng.standard_normal() + np.concatenate(
        [[0.0], np.cumsum(drift * fine[1] + steps)]
    )
    when = first_passage((LIMIT - path)[None], fine, np.array([sigma**2]), rng.random(1))[0]
    return fine, path, when


def gamma_asset(rng):
    """Likewise, of a gamma process."""
    fine = np.linspace(0.0, 3.0, 3 * 15 * FINE + 1)
    theta = THETA_CENTRE * np.exp(THETA_WIDTH * rng.standard_normal())
    rate = abs(LEVEL_WIDTH * rng.standard_normal())
    steps = rng.gamma(rate * fine[1] / theta, theta, len(fine) - 1)
    path = LEVEL_WIDTH * rng.standard_normal() + np.concatenate([[0.0], np.cumsum(steps)])
    across = path >= LIMIT
    return fine, path, float(fine[across.argmax()]) if across.any() else np.inf


def ranks(asset, foretell, runs):
    """Rank of the true failure time among those foretold, ties broken at random."""
    rng = np.random.default_rng(21)
    found: list[int] = []
    while len(found) < runs:
        fine, path, when = asset(rng)
        if when <= 1.0:
            continue
        time = fine[: 15 * FINE + 1 : FINE]
        sd = np.full(len(time), np.exp(rng.uniform(np.log(0.1), np.log(1.0))))
        value = path[: 15 * FINE + 1 : FINE] + sd * rng.standard_normal(len(time))
        drawn = foretell(history_of(time, value, sd), len(found))
        below, same = int((drawn < when).sum()), int((drawn == when).sum())
        found.append(below + int(rng.integers(0, same + 1)))
    return np.array(found)


def wiener_times(history, seed):
    futures = surviving_futures(
        history, LIMIT, 3.0, toward="above", points=80, paths=DRAWS, seed=seed
    )
    return futures.failure_time(LIMIT, toward="above")


def gamma_times(history, seed):
    posterior = GammaLaw().learn(history)
    later = np.linspace(1.0, 3.0, 3 * 15 * FINE // 3 * 2 + 1)
    rng = np.random.default_rng(seed)
    up = tuple(one for one in posterior.parts if one.sign > 0)
    if not up:
        return np.full(DRAWS, np.inf)
    paths = np.zeros((0, len(later)))
    while len(paths) < DRAWS:
        more = type(posterior)(history, up).draw(later, 2 * DRAWS, rng).paths
        paths = np.concatenate([paths, more[more[:, 0] < LIMIT]])
    paths = paths[:DRAWS]
    across = paths >= LIMIT
    return np.where(across.any(axis=1), later[across.argmax(axis=1)], np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("asset", "foretell"),
    [(wiener_asset, wiener_times), (gamma_asset, gamma_times)],
    ids=["Wiener", "gamma"],
)
def test_failure_times_given_readings_and_survival_rank_evenly(asset, foretell):
    found = ranks(asset, foretell, RUNS)
    counts = np.bincount(np.minimum(found * 20 // (DRAWS + 1), 19), minlength=20)
    p_value = stats.chisquare(counts).pvalue
    print(f"{RUNS} runs, ranks in 20 classes: {counts.tolist()}, p = {p_value:.3f}")
    assert p_value > 0.005
