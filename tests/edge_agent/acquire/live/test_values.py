"""Values of a live sensor that are no measurements are told once, repeated ones counted."""

import numpy as np

from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.acquire.live.values import ValueWatch

VALUES = np.round(np.cumsum(np.random.default_rng(1).standard_normal((2000, 2)), axis=0), 3)


def watched(rows):
    tally = SampleCounts()
    watch = ValueWatch(tally)
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


def test_a_clipped_channel_and_hum_are_told_once_in_the_first_minute_and_again_never(caplog):
    rng = np.random.default_rng(2)
    times = np.arange(60_000) / 200.0
    rows = rng.standard_normal((len(times), 2))
    rows[:, 0] = np.clip(rows[:, 0], -1.0, 1.0)
    rows[:, 1] += np.sin(2 * np.pi * 49.98 * times)
    watch = ValueWatch(SampleCounts())
    watch.begin(("a", "b"), 200.0)
    for part in np.array_split(rows[:11_000], 500):
        watch.note(part)
    assert not caplog.records
    for part in np.array_split(rows[11_000:], 2000):
        watch.note(part)
    assert [record.message.split(" in ")[0].split(" (")[0] for record in caplog.records] == [
        "Channel 'a' is clipped", "Channel 'b' has hum of the mains",
    ]  # fmt: skip
