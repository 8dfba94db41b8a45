"""Moments in every form that is promised."""

import pytest

from twin_server.serve.instants import Moment, MomentError, parse_moment


@pytest.mark.parametrize(
    ("text", "t_ns"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("2026-11-20T12:00:00Z", 1_795_176_000_000_000_000),
        ("2026-11-20T13:00:00+01:00", 1_795_176_000_000_000_000),
        ("2026-11-20T13:00:00 01:00", 1_795_176_000_000_000_000),
        ("2026-11-20T12:00:00.25Z", 1_795_176_000_250_000_000),
        ("2026-11-20T12:00:00.123456789Z", 1_795_176_000_123_456_789),
        ("1795176000000000000", 1_795_176_000_000_000_000),
    ],
)
def test_sensor_time_is_read_to_the_nanosecond(text, t_ns):
    assert parse_moment(text) == Moment(t_ns=t_ns)


@pytest.mark.parametrize(("text", "slow"), [("slow:812.5", 812.5), ("slow:-1e3", -1000.0)])
def test_slow_time_is_read(text, slow):
    assert parse_moment(text) == Moment(slow_time=slow)


@pytest.mark.parametrize(
    "text",
    ["", "now", "slow:", "slow:nan", "slow:inf", "2026-11-20T12:00:00", "12345678901234567890",
     "9999999999999999999", "-5", "1969-12-31T23:59:59Z", "2026-13-01T00:00:00Z", "٣"],
)  # fmt: skip
def test_anything_else_is_refused_with_the_forms_there_are(text):
    with pytest.raises(
        MomentError, match=r"is not a valid date and time\. Give RFC 3339.*slow:812\.5"
    ):
        parse_moment(text)
