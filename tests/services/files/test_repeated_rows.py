"""Rows that repeat the one before, and groups of a file that are several measurements."""

import numpy as np
import pytest
import scipy.io

from slowtime_services.files.record import RecordError
from slowtime_services.files.record_reader import read_record

RNG = np.random.default_rng(5)


def polled(path, *, stamps="reader", repeats=(2, 1)):
    """Write 600 readings at 100 Hz, by turns `repeats` times each."""
    values = np.round(np.cumsum(RNG.standard_normal((600, 2)), axis=0), 3)
    counts = np.resize(repeats, len(values))
    rows = np.repeat(np.arange(len(values)), counts)
    times = (
        rows / 100 if stamps == "sensor" else np.arange(len(rows)) / (100 * np.mean(repeats))
    )
    lines = ["time_s,ax,ay"]
    lines += [f"{t:.6f},{a},{b}" for t, (a, b) in zip(times, values[rows], strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return values


@pytest.mark.parametrize("stamps", ["reader", "sensor"])
@pytest.mark.parametrize("repeats", [(2, 1), (2,), (4, 3, 4)])
def test_readings_are_used_once_at_the_rate_of_the_sensor(tmp_path, stamps, repeats):
    values = polled(tmp_path / "poll.csv", stamps=stamps, repeats=repeats)
    record = read_record(tmp_path / "poll.csv")
    np.testing.assert_array_equal(record.samples, values)
    assert record.rate_hz == pytest.approx(100.0, rel=1e-3)
    assert any("polls faster than the sensor measures" in note for note in record.notes)
    kept = read_record(tmp_path / "poll.csv", repeated="keep", rate_hz=100.0)
    assert len(kept.samples) > len(values)


def test_uneven_repetition_is_a_question_that_an_option_settles(tmp_path):
    values = polled(tmp_path / "poll.csv", repeats=tuple(RNG.integers(1, 4, 600)))
    with pytest.raises(RecordError, match="--reading repeated=drop"):
        read_record(tmp_path / "poll.csv")
    dropped = read_record(tmp_path / "poll.csv", repeated="drop")
    np.testing.assert_array_equal(dropped.samples, values)
    assert len(read_record(tmp_path / "poll.csv", repeated="keep").samples) > len(values)


def test_a_given_rate_is_that_of_all_rows_or_of_new_ones(tmp_path):
    polled(tmp_path / "poll.csv")
    with pytest.raises(RecordError, match="of which rows 100 Hz is the rate"):
        read_record(tmp_path / "poll.csv", rate_hz=100.0)
    assert read_record(tmp_path / "poll.csv", rate_hz=100.0, repeated="drop").rate_hz == 100.0


def test_groups_with_times_of_their_own_are_a_question(tmp_path):
    time = np.arange(500) / 50
    first = {"Acc": RNG.standard_normal((2, 500)), "Time": time}
    second = {"Acc": RNG.standard_normal((2, 500)), "Time": time}
    scipy.io.savemat(tmp_path / "two.mat", {"Steel": first, "Brass": second})
    with pytest.raises(RecordError, match="Steel, Brass, which seem to be measured one after"):
        read_record(tmp_path / "two.mat")
    chosen = read_record(tmp_path / "two.mat", channels=("Brass.Acc_0", "Brass.Acc_1"))
    np.testing.assert_array_equal(chosen.samples, second["Acc"].T)
