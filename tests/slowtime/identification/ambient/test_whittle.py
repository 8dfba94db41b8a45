"""The search for the top of Whittle's likelihood: where it ends, and what it costs."""

import numpy as np
import pytest
import scipy.optimize

from slowtime.identification.ambient import whittle
from slowtime.identification.ambient.expected_spectrum import (
    PredictedPeriodogram,
    expected_resonance,
)
from slowtime.identification.ambient.whittle import (
    Periodogram,
    fit_resonance,
    group_ordinates,
    whittle_log_likelihood,
)

RATE_HZ, COUNT = 20.0, 3000


def ordinates(seed, derivatives=2, damping=0.02, floor=1e-3, natural=5.0):
    """A periodogram about what is expected of a mode, each ordinate exponential."""
    rng = np.random.default_rng(seed)
    frequency = np.arange(60, 1400) * RATE_HZ / COUNT
    expected = floor + expected_resonance(
        frequency, natural_hz=natural, damping_ratio=damping, rate_hz=RATE_HZ, count=COUNT,
        derivatives=derivatives,
    )  # fmt: skip
    whole = Periodogram(
        frequency_hz=frequency, density=expected * rng.exponential(size=len(frequency)),
        number=np.ones(len(frequency)), rate_hz=RATE_HZ, count=COUNT, derivatives=derivatives,
    )  # fmt: skip
    return group_ordinates(whole.within(3.8, 6.2), natural)


@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize(("natural", "damping"), [(5.0, 0.02), (2.0, 0.3), (4.9, 0.002)])
def test_slopes_of_a_prediction_are_its_derivatives(derivatives, natural, damping):
    frequency = np.arange(40, 1400) * RATE_HZ / COUNT
    value, slopes = PredictedPeriodogram(frequency, RATE_HZ, COUNT, derivatives).at(
        natural, damping
    )

    def predicted(f, z):
        return expected_resonance(
            frequency, natural_hz=natural * np.exp(f), damping_ratio=damping * np.exp(z),
            rate_hz=RATE_HZ, count=COUNT, derivatives=derivatives,
        )  # fmt: skip

    np.testing.assert_allclose(value, predicted(0, 0), rtol=1e-10)
    for (f, z), slope in zip(((1e-4 * damping, 0), (0, 1e-4)), slopes, strict=True):
        differences = (predicted(f, z) - predicted(-f, -z)) / (2 * (f + z))
        assert np.abs(slope - differences).max() <= 1e-5 * np.abs(differences).max()


def start(data):
    return np.log([5.02, 0.03, data.density.max(), 1e-2])


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_the_top_is_that_of_a_search_without_slopes(seed, colour):
    data = ordinates(seed)
    begin = np.append(start(data), 0.0) if colour else start(data)
    found = fit_resonance(data, begin)
    assert found.converged
    prior = np.array([0, 0, 0, whittle.FLOOR_PRIOR, whittle.COLOUR_PRIOR])[: len(begin)]
    model = PredictedPeriodogram(data.frequency_hz, RATE_HZ, COUNT, data.derivatives)

    def depth(theta):
        shape, _ = model.at(*np.exp(theta[:2]))
        force = np.exp(theta[4] * (np.log(data.frequency_hz) - theta[0])) if colour else 1.0
        expected = np.exp(theta[2]) * shape * force + np.exp(theta[3])
        away = theta - np.append(begin[:4], 0.0)[: len(theta)]
        return -whittle_log_likelihood(data, expected) + prior @ away**2 / 2

    other = scipy.optimize.minimize(
        depth, found.parameters, method="Nelder-Mead",
        options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000, "maxfev": 4000},
    )  # fmt: skip
    away = found.parameters - other.x
    assert away @ np.linalg.solve(found.covariance, away) < 1e-4


def test_a_search_looks_at_few_places(monkeypatch):
    """Where floor and damping say nearly the same, plain scoring looks at sixty."""
    looked = 0
    plain = PredictedPeriodogram.at

    def counted(self, *args):
        nonlocal looked
        looked += 1
        return plain(self, *args)

    monkeypatch.setattr(PredictedPeriodogram, "at", counted)
    counts = []
    for seed in range(20):
        data = ordinates(seed, damping=0.012, floor=2e-3)
        for begin in (start(data), np.append(start(data), 0.0)):
            looked = 0
            assert fit_resonance(data, begin).converged
            counts.append(looked)
    assert np.mean(counts) < 15
    assert max(counts) < 40
