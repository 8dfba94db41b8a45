"""A live sensor that is polled faster than it measures is counted and told once."""

import numpy as np

from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.acquire.live.repeats import RepeatWatch

VALUES = np.round(np.cumsum(np.random.default_rng(1).standard_normal((2000, 2)), axis=0), 3)


def watched(rows):
    tally = SampleCounts()
    watch = RepeatWatch(tally)
    for part in np.array_split(rows, len(rows) // 20):
        watch.note(part)
    return tally["samples_repeated"]


def test_a_third_of_the_samples_that_repeat_is_counted(caplog):
    rows = VALUES[(np.arange(3000) / 1.5).astype(int)]
    counted = watched(rows)
    assert 0.28 < counted / 3000 < 0.34  # but for the last few hundred
    assert caplog.text.count("polled faster than it measures") == 1


def test_a_sensor_that_is_read_in_time_is_not(caplog):
    assert watched(VALUES) == 0
    assert "polled" not in caplog.text
