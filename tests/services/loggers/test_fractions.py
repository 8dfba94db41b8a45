"""Fractions of a second in a column of their own are part of the clock."""

import datetime

import numpy as np
import pytest

from slowtime_services.files import read_record

ROWS = 640
START = datetime.datetime(2024, 4, 21, 15, 0, 0, tzinfo=datetime.UTC)
START_NS = round(START.timestamp()) * 10**9
X, Y = np.random.default_rng(12).normal(size=(2, ROWS)).round(4)


def micros(rate):
    return [round(i * 1e6 / rate) for i in range(ROWS)]


def stamps(form, rate, micros_before=0):
    """Whole seconds as text, those of the first row moved by some microseconds."""
    moved = [START + datetime.timedelta(microseconds=u + micros_before) for u in micros(rate)]
    return [when.strftime(form) for when in moved]


def parts(rate, per_second, digits=0, micros_before=0):
    """What is above the whole second, in counts."""
    within = [(u + micros_before) % 10**6 for u in micros(rate)]
    return [str(u * per_second // 10**6).zfill(digits) for u in within]


@pytest.fixture
def read(tmp_path):
    def reading(heading, *columns, mark=",", **given):
        path = tmp_path / "file.csv"
        rows = [mark.join(map(str, fields)) for fields in zip(*columns, strict=True)]
        path.write_text("\n".join([*([heading] * bool(heading)), *rows]) + "\n")
        return read_record(path, skip_missing=True, **given)

    return reading


@pytest.mark.parametrize("rate", [20.0, 125.0, 200.0, 62.5])
def test_milliseconds_beside_stamps_are_part_of_the_clock(read, rate):
    date, time = stamps("%Y-%m-%d", rate), stamps("%H:%M:%S", rate)
    ms = parts(rate, 1000)
    for heading, columns in (
        ("Date,Time,Millisecond,ax,ay", (date, time, ms)),
        ("Timestamp,ms,ax,ay", (stamps("%Y-%m-%d %H:%M:%S", rate), ms)),
        ("Timestamp,,ax,ay", (stamps("%Y-%m-%d %H:%M:%S", rate), ms)),
        ("time,ax,ay", (stamps("%Y-%m-%d %H:%M:%S", rate), parts(rate, 1000, 3))),
        ("Year,Month,Day,Hour,Minute,Second,Millisecond,ax,ay",
         (*(stamps(f, rate) for f in ("%Y", "%m", "%d", "%H", "%M", "%S")), ms)),
    ):  # fmt: skip
        record = read(heading, *columns, X, Y)
        assert record.channels == ("ax", "ay"), heading
        assert record.rate_hz == pytest.approx(rate, rel=1e-6), heading
        assert record.start_ns == START_NS, heading
        np.testing.assert_array_equal(record.samples, np.column_stack([X, Y]))


@pytest.mark.parametrize(
    ("names", "per_second"),
    [
        ("sec,usec", 10**6), ("header.stamp.sec,header.stamp.nanosec", 10**9), ("s,ms", 1000),
        ("epoch,us", 10**6), ("time,ns", 10**9),
    ],
)  # fmt: skip
def test_seconds_and_fractions_as_numbers(read, names, per_second):
    seconds = [START_NS // 10**9 + u // 10**6 for u in micros(200.0)]
    record = read(f"{names},ax,ay", seconds, parts(200.0, per_second), X, Y)
    assert (record.channels, record.start_ns) == (("ax", "ay"), START_NS)
    assert record.rate_hz == pytest.approx(200.0)


def test_a_decimal_comma_of_stamps_beside_rows_with_commas(read):
    times = stamps("%Y-%m-%d %H:%M:%S", 100.0, 250_000)
    record = read("", times, parts(100.0, 1000, 3, 250_000), X, Y)
    assert record.samples.shape == (ROWS, 2)
    assert (record.rate_hz, record.start_ns) == (100.0, START_NS + 250_000_000)


def test_lost_rows_stay_gaps(read):
    kept = [i for i in range(ROWS) if not 150 <= i < 270]
    columns = (stamps("%Y-%m-%d %H:%M:%S", 100.0), parts(100.0, 1000), X, Y)
    record = read("Time,ms,ax,ay", *([column[i] for i in kept] for column in columns))
    assert [gap.missing for gap in record.gaps] == [120]
    assert record.rate_hz == pytest.approx(100.0)


def test_milliseconds_since_power_on_are_no_fraction(read):
    since = [4321 + u // 1000 for u in micros(100.0)]
    record = read("Time,ms,ax,ay", stamps("%H:%M:%S", 100.0), since, X, Y)
    assert record.channels == ("ax", "ay")
    assert record.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize("step", [5, 7])
def test_a_column_that_does_not_start_anew_with_each_second_stays_a_channel(read, step):
    saw = [(step * i) % 1000 for i in range(ROWS)]
    record = read("Time,,ay", stamps("%Y-%m-%d %H:%M:%S", 100.0), saw, Y)
    assert len(record.channels) == 2


def test_a_date_of_midnights_goes_with_the_time_beside_it(read):
    date = ["2024-04-21 00:00:00"] * ROWS
    record = read("Date,Time,ax", date, stamps("%H:%M:%S.%f", 100.0), X)
    assert (record.rate_hz, record.start_ns) == (100.0, START_NS)
