"""Rows of a loop that takes more or less time are interpolated at even times."""

import numpy as np
import pytest

from slowtime_services.files.record import RecordError
from slowtime_services.files.record_reader import read_record
from slowtime_services.files.times.time_axis import read_time

STEP_S = 1.9e-3


def motion(t):
    return 3.0 * np.exp(-0.8 * t) * np.sin(2 * np.pi * 22.0 * t + 0.4)


def loop_times(count=1500, pause_after=None, pause_s=0.0):
    """Times of a loop that slows down by 3 % in its middle and scatters by 1 %."""
    k = np.arange(count - 1)
    steps = STEP_S * (1 + 0.03 * np.exp(-(((k - 700) / 200) ** 2)))
    steps *= 1 + 0.01 * np.random.default_rng(1).standard_normal(count - 1)
    if pause_after is not None:
        steps[pause_after] += pause_s
    return np.concatenate([[0.0], np.cumsum(steps)])


def written(path, t, values, begun_us=19_202_812):
    stamps = begun_us + np.round(1e6 * t).astype(int)
    rows = "".join(f"{a},{b:.5f}\n" for a, b in zip(stamps, values, strict=True))
    path.write_text("time_us,a (m/s^2)\n" + rows)
    return path


def test_rows_of_a_wandering_loop_are_read_at_even_times(tmp_path):
    t = loop_times()
    record = read_record(written(tmp_path / "loop.csv", t, motion(t)))
    assert record.rate_hz == pytest.approx((len(t) - 1) / t[-1], rel=1e-6)
    even = np.arange(len(record.samples)) / record.rate_hz
    assert np.abs(record.samples[:, 0] - motion(even)).max() < 5e-3
    # Rows taken as even would be out by several tenths.
    assert np.abs(motion(t[: len(even)]) - motion(even)).max() > 0.3
    assert not record.gaps
    assert any("wanders from" in note and "interpolated" in note for note in record.notes)
    assert all(len(column) == len(even) for column in record.aux.values())


def test_a_pause_of_a_wandering_loop_is_a_gap_of_the_even_times(tmp_path):
    t = loop_times(pause_after=900, pause_s=40 * STEP_S)
    record = read_record(written(tmp_path / "loop.csv", t, motion(t)))
    (gap,) = record.gaps
    assert gap.missing in (40, 41)
    instants = np.arange(len(record.samples), dtype=float)
    instants[gap.row :] += gap.missing
    assert np.abs(record.samples[:, 0] - motion(instants / record.rate_hz)).max() < 5e-3


def test_a_saturated_sensor_is_not_swung_beyond_its_range(tmp_path):
    t = loop_times()
    clipped = np.clip(motion(t), -1.0, 1.0)
    record = read_record(written(tmp_path / "loop.csv", t, clipped))
    found = record.samples[:, 0]
    assert np.count_nonzero(np.abs(found) == 1.0) > 0.8 * np.count_nonzero(abs(clipped) == 1.0)


def test_a_given_rate_takes_rows_as_they_are(tmp_path):
    t = loop_times()
    record = read_record(written(tmp_path / "loop.csv", t, motion(t)), rate_hz=520.0)
    assert record.rate_hz == 520.0
    np.testing.assert_allclose(record.samples[:, 0], motion(t), atol=1e-5)


@pytest.mark.parametrize("late_steps", [0.45, 0.8])
def test_stamps_that_are_late_at_random_are_refused(late_steps):
    late = late_steps * STEP_S * np.random.default_rng(2).standard_normal(1500)
    with pytest.raises(RecordError, match="too uneven"):
        read_time(np.sort(np.arange(1500) * STEP_S + late))


@pytest.mark.parametrize("lost", [0.0, 0.05])
@pytest.mark.parametrize("jitter_steps", [0.1, 0.25])
def test_samples_that_jitter_as_their_stamps_do_are_read_at_even_times(
    tmp_path, jitter_steps, lost
):
    rng = np.random.default_rng(3)
    there = np.flatnonzero(rng.random(4000) >= lost)
    t = 1e-2 * (there + rng.uniform(-jitter_steps, jitter_steps, len(there)))
    t -= t[0]
    values = wave(t) + 0.05 * rng.standard_normal(len(t))
    record = read_record(written(tmp_path / "jitter.csv", t, values))
    assert any("jitter as their stamps do" in note for note in record.notes)
    instants = np.arange(len(record.samples))
    for gap in record.gaps:
        instants[gap.row :] += gap.missing
    left = record.samples[:, 0] - wave(instants / record.rate_hz)
    assert left.std() < 0.08
    assert len(record.samples) > 0.99 * len(t)


def test_samples_taken_evenly_but_stamped_late_stay_as_they_are(tmp_path):
    rng = np.random.default_rng(3)
    even = 1e-2 * np.arange(4000)
    values = np.round(wave(even) + 0.05 * rng.standard_normal(4000), 5)
    late = even + 1e-2 * rng.uniform(-0.25, 0.25, 4000)
    record = read_record(written(tmp_path / "late.csv", late - late[0], values))
    assert np.array_equal(record.samples[:, 0], values)
    assert any("clock jitters by 14 %" in note for note in record.notes)


def wave(t):
    return np.sin(2 * np.pi * 7.0 * t) + np.sin(2 * np.pi * 23.0 * t + 1.0)
