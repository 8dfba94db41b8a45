"""A choice of window, median and EWMA keeps what it promises, on simulated years."""

import math

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter

from slowtime.signals.smoother_choice import (
    YEAR_S,
    choose_smoother,
    limit_factor,
    run_length,
    settled_sd,
)
from slowtime.signals.smoothing import MedianEwma

ASKED = {
    "drop": 0.02, "within_s": 86_400.0, "false_alarms_per_year": 2.0, "sd": 0.003,
    "sd_window_s": 600.0, "shortest_window_s": 600.0,
}  # fmt: skip


def smoothed(readings, choice):
    """Median and EWMA of rows, by SciPy and NumPy; readings before the first are as it is."""
    rest = ((0, 0), (choice.median_window - 1, 0))
    wide = np.pad(readings, rest, mode="edge")
    medians = np.median(sliding_window_view(wide, choice.median_window, axis=1), axis=2)
    a = choice.ewma_a
    return lfilter([a], [1.0, a - 1.0], medians, axis=1)


def sd_of(choice, asked):
    return asked["sd"] * math.sqrt(asked["sd_window_s"] / choice.window_s)


def episodes(course, limit):
    """Falls below the limit, each counted once until half of it is regained."""
    count, alarmed = 0, False
    for value in course[(course < -limit) | (course > -limit / 2)]:
        count += value < -limit and not alarmed
        alarmed = value < -limit
    return count


@pytest.mark.parametrize("outliers", [0, 1, 2])
def test_false_alarms_are_as_rare_as_promised(outliers):
    choice = choose_smoother(**ASKED, outliers_in_a_row=outliers)
    rng = np.random.default_rng(outliers)
    readings = rng.normal(0.0, sd_of(choice, ASKED), (40, int(YEAR_S / choice.window_s)))
    count = sum(episodes(course, choice.limit) for course in smoothed(readings, choice))
    asked = 40 * ASKED["false_alarms_per_year"]
    assert 0.05 * asked < count < asked + 2.0 * math.sqrt(asked)


@pytest.mark.parametrize(
    ("outliers", "within_s"), [(0, 6 * 3600.0), (1, 86_400.0), (2, 86_400.0), (2, 432_000.0)]
)
def test_the_smallest_drop_is_noticed_in_time(outliers, within_s):
    asked = ASKED | {"within_s": within_s, "shortest_window_s": 60.0}
    choice = choose_smoother(**asked, outliers_in_a_row=outliers)
    rng = np.random.default_rng(7)
    before = int(12 / choice.ewma_a) + choice.median_window
    after = int(within_s / choice.window_s) + 2
    # The drop falls anywhere within a window, whose reading then shows a part of it.
    part = rng.uniform(size=1000)[:, None]
    number = np.arange(before + after)[None, :] - before
    level = -choice.smallest_drop * np.clip(number + 1.0 - part, 0.0, 1.0)
    course = smoothed(level + rng.normal(0.0, sd_of(choice, asked), level.shape), choice)
    in_time = (number >= 0) & ((number + 1.0 - part) * choice.window_s <= within_s)
    noticed = ((course < -choice.limit) & in_time).any(axis=1).mean()
    assert noticed > 0.9 - 2.0 * math.sqrt(0.09 / 1000)


def test_run_lengths_are_those_of_simulated_courses():
    rng = np.random.default_rng(5)
    for a, limit in ((0.1, 2.0), (0.4, 2.0), (1.0, 2.5)):
        settled = math.sqrt(a / (2.0 - a))
        course = lfilter([a], [1.0, a - 1.0], rng.standard_normal((1000, 2000)), axis=1)
        over = course > limit * settled
        assert over.any(axis=1).mean() > 0.99
        lengths = np.argmax(over, axis=1) + 1
        assert run_length(a, limit) == pytest.approx(lengths.mean(), rel=0.1)
        assert limit_factor(a, run_length(a, limit)) == pytest.approx(limit, abs=1e-3)


@pytest.mark.parametrize(("window", "a"), [(1, 0.3), (5, 0.3), (9, 0.05), (3, 1.0)])
def test_the_settled_deviation_is_what_the_stream_tells(window, a):
    smoother = MedianEwma(window=window, a=a)
    state = smoother.start()
    for _ in range(500):
        state, smooth = smoother.step(state, 0.0, 1.0)
    assert settled_sd(smoother) == pytest.approx(smooth.sd, rel=1e-3)


def test_with_more_time_more_alarms_or_no_outliers_smaller_drops_are_noticed():
    def smallest(**changed):
        return choose_smoother(**(ASKED | changed)).smallest_drop

    assert smallest(within_s=4 * 86_400.0) < smallest() < smallest(within_s=43_200.0)
    assert smallest(false_alarms_per_year=20.0) < smallest()
    assert smallest(outliers_in_a_row=0) < smallest()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"drop": 1e-5}, "A drop of .* can be"),
        ({"within_s": 600.0}, "Windows of 600 s are too long"),
        ({"drop": 1.5}, r"drop=1.5 was given\. Allowed: between 0 and 1"),
        ({"sd": math.nan}, r"sd=nan was given\. Allowed: finite"),
        ({"outliers_in_a_row": 50}, r"Allowed: 0 to 49"),
        ({"probability": 1.0}, r"Allowed: from 0.5 to below 1"),
        ({"false_alarms_per_year": 1e7}, "was asked for"),
    ],
)
def test_what_cannot_be_had_is_refused_with_what_can(changed, words):
    with pytest.raises(ValueError, match=words):
        choose_smoother(**(ASKED | changed))
