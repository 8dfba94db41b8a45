"""The start of a record: orders of dates, time zones, and times of something else."""

import datetime

import numpy as np
import pytest

from slowtime_services.files import read_record

ROWS = 500
START = datetime.datetime(2024, 4, 21, 15, 0, 0, tzinfo=datetime.UTC)
NIGHT = datetime.datetime(2024, 4, 21, 23, 59, 58, tzinfo=datetime.UTC)
X = np.random.default_rng(5).normal(size=ROWS).round(4)
HOUR_NS = 3600 * 10**9


def ns(when):
    return round(when.timestamp()) * 10**9


def stamps(form, start=START):
    when = [start + datetime.timedelta(milliseconds=10 * i) for i in range(ROWS)]
    return [w.strftime(form).replace("%L", f"{w.microsecond // 1000:03d}") for w in when]


@pytest.fixture
def read(tmp_path):
    def reading(heading, times, **given):
        path = tmp_path / "file.csv"
        rows = [f"{t},{x}" for t, x in zip(times, X, strict=True)]
        path.write_text(heading + "\n" + "\n".join(rows) + "\n")
        return read_record(path, **given)

    return reading


SECONDS = [f"{i / 100:.2f}" for i in range(ROWS)]
ISO = stamps("%Y-%m-%d %H:%M:%S.%f")


@pytest.mark.parametrize("form", ["%y/%m/%d", "%y-%m-%d", "%d/%m/%y", "%d-%m-%y"])
def test_dates_of_three_short_numbers_leave_the_start_open(read, form):
    times = stamps(f"{form} %H:%M:%S.%f")
    record = read("Time,ax", times)
    assert (record.rate_hz, record.start_ns) == (100.0, None)
    assert any("--reading date_order=dmy, mdy or ymd" in note for note in record.notes)
    order = "".join(letter for letter in form if letter in "ymd")
    assert read("Time,ax", times, date_order=order).start_ns == ns(START)


@pytest.mark.parametrize(
    ("form", "start"),
    [
        ("%m/%d/%y %H:%M:%S.%f", START),
        ("%m/%d/%y %I:%M:%S.%f %p", datetime.datetime(2024, 4, 5, 15, tzinfo=datetime.UTC)),
        ("%y/%m/%d %H:%M:%S.%f", datetime.datetime(2024, 4, 24, 15, tzinfo=datetime.UTC)),
        ("%d.%m.%y %H:%M:%S.%f", START),
        ("%y/%m/%d %H:%M:%S.%f", datetime.datetime(1998, 4, 21, 15, tzinfo=datetime.UTC)),
        ("%y/%m/%d %H:%M:%S.%f", NIGHT),
        ("%d/%m/%y %H:%M:%S.%f", NIGHT),
    ],
)  # fmt: skip
def test_dates_that_can_be_read_in_one_way_only_tell_the_start(read, form, start):
    assert read("Time,ax", stamps(form, start)).start_ns == ns(start)


def test_a_year_in_four_digits_is_last_whatever_order_is_given(read):
    times = stamps("%d/%m/%Y %H:%M:%S.%f")
    assert read("Time,ax", times, date_order="ymd").start_ns == ns(START)


@pytest.mark.parametrize(
    ("name", "hours"),
    [
        ("Timestamp (UTC+02:00)", 2), ("Time [CEST]", 2), ('"Date Time, GMT-04:00"', -4),
        ("Time (UTC)", 0), ("Zeit (MEZ)", 1), ("Time (GMT+5:30)", 5.5), ("Time [EDT]", -4),
        ("Time UTC+0200", 2),
    ],
)  # fmt: skip
def test_the_zone_in_the_name_of_a_clock_is_used(read, name, hours):
    record = read(f"{name},ax", ISO)
    assert record.start_ns == ns(START) - round(hours * HOUR_NS)
    said = " ".join(record.assumptions)
    assert "state" in said
    assert "no time zone is stated" not in said


@pytest.mark.parametrize(
    ("line", "hours"),
    [
        ("Time zone: UTC+2", 2), ("UTC offset: -4", -4), ("UTC offset (min): 120", 2),
        ("TZ,+02:00", 2), ("Zeitzone: MESZ", 2), ("GMT offset = +9 h", 9),
        ("Time zone offset: -5", -5),
    ],
)  # fmt: skip
def test_the_zone_of_a_heading_holds_for_stamps_and_for_the_start_it_states(read, line, hours):
    expected = ns(START) - round(hours * HOUR_NS)
    assert read(f"{line}\nTime,ax", ISO).start_ns == expected
    heading = f"{line}\nStart time: 2024-04-21 15:00:00\nt [s],ax"
    assert read(heading, SECONDS).start_ns == expected


@pytest.mark.parametrize("zone", ["Europe/Berlin", "CST", "local"])
def test_a_zone_without_a_fixed_offset_is_said_to_be_not_understood(read, zone):
    for heading in (f"Time ({zone}),ax", f"Time zone: {zone}\nTime,ax"):
        record = read(heading, ISO)
        assert record.start_ns == ns(START)
        assert any(f"'{zone}' was not understood" in said for said in record.assumptions)


def test_stamps_with_a_zone_of_their_own_are_not_moved_again(read):
    times = stamps("%Y-%m-%dT%H:%M:%S.%f+02:00")
    assert read("Time zone: UTC+2\nTime (UTC+02:00),ax", times).start_ns == (
        ns(START) - 2 * HOUR_NS
    )
    times = stamps("%Y-%m-%d %H:%M:%S.%f CEST")
    assert read("Time,ax", times).start_ns == ns(START) - 2 * HOUR_NS


@pytest.mark.parametrize(
    "key",
    [
        "Logger download time", "Recorder firmware", "Measurement system installed",
        "Data logger clock set", "Monitoring start", "Logger started up by power",
        "Acquisition software build", "Measuring chain calibrated", "Recorder serial date",
    ],
)  # fmt: skip
def test_times_of_devices_are_no_start(read, key):
    assert read(f"{key}: 2019-03-02 10:00:00\nt [s],ax", SECONDS).start_ns is None


@pytest.mark.parametrize(
    "line",
    [
        "Recorded: {}", "Recording date: {}", "Measured on {}", "Date/Time: {}",
        "Aufnahme vom {}",
        "Trigger time: {}", "Tower A recording start: {}", "Log started: {}", "T0 = {}",
        "Acquisition date and time: {}", "Time of first sample: {}", "Start Time (UTC): {}",
    ],
)  # fmt: skip
def test_times_of_a_recording_are_its_start(read, line):
    record = read(line.format("2024-04-21 15:00:00") + "\nt [s],ax", SECONDS)
    assert record.start_ns == ns(START)
    assert not any("not understood" in said for said in record.assumptions)


@pytest.mark.parametrize("line", ["Zone offset: 3 m", "Time zone: 3 m"])
def test_a_length_is_no_time_zone(read, line):
    assert read(f"{line}\nTime,ax", ISO).start_ns == ns(START)
