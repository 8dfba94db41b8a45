"""Questions about uneven times name the cause, where the times themselves tell it."""

import datetime
import re

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record

ROWS = 600
X = np.random.default_rng(2).normal(size=ROWS).round(4)


@pytest.fixture
def refusal(tmp_path):
    def reading(times):
        path = tmp_path / "file.csv"
        rows = [f"{t},{x}" for t, x in zip(times, X, strict=True)]
        path.write_text("# site A\nTime [s],ax\n" + "\n".join(rows) + "\n")
        with pytest.raises(RecordError) as found:
            read_record(path)
        return str(found.value)

    return reading


@pytest.mark.parametrize("pause", [0.0, 30.0])
def test_a_rate_that_changes_midway_is_located(refusal, pause):
    steps = np.r_[np.full(350, 0.005), np.full(ROWS - 351, 0.01)]
    times = np.r_[0.0, np.cumsum(steps)]
    times[350:] += pause
    line = 3 + 350
    said = refusal([f"{t:.3f}" for t in times])
    assert f"changes at line {line} from 200 to 100 Hz" in said
    assert "--rate-hz" in said


def test_times_that_are_uneven_throughout_have_no_change_of_rate(refusal):
    steps = np.random.default_rng(4).uniform(0.001, 0.02, ROWS)
    assert "changes at" not in refusal([f"{t:.4f}" for t in np.cumsum(steps)])


def test_the_end_of_daylight_saving_time_is_named_with_its_date(refusal):
    start = datetime.datetime(2024, 10, 27, 2, 59, 57)  # noqa: DTZ001
    when = [start + datetime.timedelta(milliseconds=10 * i) for i in range(ROWS)]
    hour = datetime.timedelta(hours=1)
    said = refusal([str(w - hour if w.hour == 3 else w) for w in when])
    assert "from 2024-10-27 02:59:59.99 to 2024-10-27 02:00:00 (1 such" in said
    assert "end of daylight saving time" in said


@pytest.mark.parametrize("date", ["", "2024-04-21 "])
def test_fractions_without_leading_zeros_are_named(refusal, date):
    times = [f"{date}15:00:{i // 100:02d}.{10 * i % 1000}" for i in range(ROWS)]
    said = refusal(times)
    assert f"from {date}15:00:00.9 to {date}15:00:00.1" in said
    assert "leading zeros" in said


def test_rows_out_of_order_are_neither(refusal):
    times = [f"2024-04-21 15:00:{i / 100:06.3f}" for i in range(ROWS)]
    times[40], times[240] = times[240], times[40]
    said = refusal(times)
    assert "daylight" not in said
    assert "leading zeros" not in said


def test_a_clock_that_was_set_back_is_named_with_the_rate_that_goes_on(refusal, tmp_path):
    times = np.arange(ROWS) / 100.0
    times[300:] -= 0.25
    said = refusal([f"{t:.4f}" for t in times])
    assert (
        "if the clock was set back by 0.25 s while sampling went on, give --rate-hz 100."
        in said
    )
    assert len(read_record(tmp_path / "file.csv", rate_hz=100).samples) == ROWS


@pytest.mark.parametrize(("by", "missing"), [(0.004, 0), (0.503, 50)])
def test_a_clock_that_was_set_forwards_is_noted(tmp_path, by, missing):
    times = np.arange(ROWS) / 100.0
    times[300:] += by
    path = tmp_path / "set.csv"
    rows = [f"{t:.4f},{x}" for t, x in zip(times, X, strict=True)]
    path.write_text("Time [s],ax\n" + "\n".join(rows) + "\n")
    found = read_record(path)
    (said,) = [note for note in found.notes if "The clock was set" in note]
    assert f"at line 302: a step of {0.01 + by:.4g} s is no whole number of samples." in said
    assert sum(gap.missing for gap in found.gaps) == missing
    assert found.rate_hz == pytest.approx(100.0, rel=2e-3)


def test_late_stamps_and_jitter_are_no_clock_that_was_set(tmp_path):
    rng = np.random.default_rng(3)
    late = np.arange(ROWS) / 100.0
    late[[100, 250]] += 0.004
    shaken = np.arange(ROWS) / 100.0 + rng.normal(0, 2e-4, ROWS)
    for name, times in (("late", late), ("shaken", shaken)):
        path = tmp_path / f"{name}.csv"
        rows = [f"{t:.5f},{x}" for t, x in zip(times, X, strict=True)]
        path.write_text("Time [s],ax\n" + "\n".join(rows) + "\n")
        assert not any("was set" in note for note in read_record(path).notes)


def stamps(jitter, seed=5):
    """Return even times at 50 Hz with normal jitter [steps], in order."""
    late = jitter * np.random.default_rng(seed).standard_normal(ROWS)
    return [f"{t:.6f}" for t in np.sort((np.arange(ROWS) + 9 + late) / 50.0)]


def test_stamps_that_jitter_beyond_half_a_step_are_not_taken_for_losses(tmp_path):
    path = tmp_path / "file.csv"
    rows = [f"{t},{x}" for t, x in zip(stamps(0.2), X, strict=True)]
    path.write_text("Time [s],ax\n" + "\n".join(rows) + "\n")
    record = read_record(path)
    assert record.gaps == ()
    assert record.rate_hz == pytest.approx(50.0, rel=1e-4)
    assert any("jitters by 2" in note or "jitters by 1" in note for note in record.notes)


def test_a_loss_among_jittering_stamps_is_one(tmp_path):
    path = tmp_path / "file.csv"
    times = [t for k, t in enumerate(stamps(0.08)) if k not in (200, 201)]
    path.write_text("Time [s],ax\n" + "".join(f"{t},{k % 7}\n" for k, t in enumerate(times)))
    (gap,) = read_record(path).gaps
    assert (gap.row, gap.missing) == (200, 2)


def test_the_advice_for_more_jitter_can_be_followed(refusal, tmp_path):
    said = refusal(stamps(0.35))
    assert "about a steady rate of" in said
    (rate,) = re.findall(r"Give --rate-hz ([\d.]+) ", said)
    record = read_record(tmp_path / "file.csv", rate_hz=float(rate))
    assert record.gaps == ()
    np.testing.assert_array_equal(record.samples[:, 0], X)
