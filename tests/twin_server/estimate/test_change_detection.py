"""After a jump the twin says within five epochs that the model has changed; and only then."""

import numpy as np
import pytest

from twin_server.estimate import Detector

SD = 0.004


def watched(values, odds=1e4, sd=SD):
    """Readings of a series, and what was noticed at which."""
    series = Detector(odds)
    found = []
    for time, value in enumerate(values):
        noticed = series.take(float(time), float(value), sd)
        if noticed is not None:
            found.append((time, noticed))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_a_jump_is_noticed_within_five_readings_and_the_watch_goes_on_after_it(seed):
    rng = np.random.default_rng([61, seed])
    first, second = int(rng.integers(29, 40)), int(rng.integers(60, 70))
    time = np.arange(76)
    truth = -4e-4 * time - 0.06 * (time >= first) + 0.04 * (time >= second)
    found = watched(truth + SD * rng.standard_normal(len(time)))
    assert [first <= at <= first + 4 for at, _ in found[:1]] == [True]
    assert [second <= at <= second + 4 for at, _ in found[1:]] == [True]
    for at, size, (_, noticed) in zip((first, second), (-0.06, 0.04), found, strict=True):
        assert noticed.since == at - 1
        assert noticed.size == pytest.approx(size, abs=4 * noticed.sd)
        assert noticed.odds > 1e4


def test_drift_wave_noise_and_outliers_are_no_change_of_the_model():
    rng = np.random.default_rng(62)
    time = np.arange(100)
    values = -3e-4 * time + 0.02 * np.sin(time / 15.0) + SD * rng.standard_normal(100)
    values[[47, 80]] += 0.1
    assert watched(values) == []


def test_readings_that_are_not_later_and_those_without_error_do_no_harm():
    series = Detector(1e4)
    for time in (0.0, 1.0, 1.0, 0.5, *range(2, 34)):
        assert series.take(float(time), 0.0, 0.0) is None
    assert [reading[0] for reading in series.past[:3]] == [0.0, 1.0, 2.0]
