"""A sensor that falls silent is told once, its return once, and losses not too often."""

import pytest

from slowtime_schemas.messages import Health
from twin_server.collect import SensorWatch
from twin_server.collect.sensors import TOLD_EVERY_S


def health(sequence=0, *, boot="b1", asset="beam", **counters):
    return Health(
        site="lab",
        asset=asset,
        boot=boot,
        sequence=sequence,
        t_ns=10**18 + sequence,
        last_sequence=-1,
        first_held=-1,
        uptime_s=1.0,
        counters={"sensor_silent_s": 0, "samples_lost": 0, "samples_dropped": 0} | counters,
    )


def told(watch, *healths, now_s=0.0):
    return [(notice.kind, notice.severity) for notice in watch.hear(healths, now_s)]


def test_silence_is_an_alarm_once_and_the_return_is_told_once():
    watch = SensorWatch()
    assert told(watch, health()) == []
    assert told(watch, health(sensor_silent_s=10), health(sensor_silent_s=11)) == [
        ("sensor_silent", "alarm")
    ]
    assert told(watch, health(), health()) == [("sensor_back", "info")]
    (again,) = watch.hear([health(sensor_silent_s=60)], 0.0)
    assert "nothing for 60 s" in again.message


def test_losses_are_told_at_once_and_then_together():
    watch = SensorWatch()
    (first,) = watch.hear([health(samples_lost=8)], 0.0)
    assert (first.kind, first.details["more"]) == ("samples_lost", 8)
    assert told(watch, health(samples_lost=9), now_s=1.0) == []
    (later,) = watch.hear([health(samples_lost=20, samples_dropped=5)], TOLD_EVERY_S + 1)
    assert later.details == {"more": 17, "lost": 20, "dropped": 5}
    assert "fell behind" in later.message
    assert told(watch, health(samples_lost=20, samples_dropped=5), now_s=2e4) == []


def test_an_agent_that_began_anew_counts_from_nothing():
    watch = SensorWatch()
    watch.hear([health(samples_lost=100)], 0.0)
    (notice,) = watch.hear([health(boot="b2", samples_lost=3)], 2 * TOLD_EVERY_S)
    assert notice.details["more"] == 3


def test_an_input_that_is_not_live_has_no_sensor():
    watch = SensorWatch()
    plain = health().model_copy(update={"counters": {"blocks": 5}})
    assert told(watch, plain) == []
    assert watch.of("lab", "beam") is None
    watch.hear([health(samples_lost=2)], 0.0)
    assert (watch.of("lab", "beam") or {})["samples_lost"] == 2
    watch.forget("lab", "beam")
    assert watch.of("lab", "beam") is None


def test_each_restart_of_an_own_source_is_told():
    watch = SensorWatch()
    assert told(watch, health(source_restarts=0)) == []
    assert told(watch, health(source_restarts=1)) == [("source_restarted", "warning")]
    assert told(watch, health(source_restarts=1)) == []
    (notice,) = watch.hear([health(source_restarts=3)], 0.0)
    assert notice.details == {"more": 2, "restarts": 3}
    assert told(watch, health(boot="b2", source_restarts=1)) == [
        ("source_restarted", "warning")
    ]


SILENT = {"kind": "sensor_silent", "details": {"silent_s": 10}}
BACK = {"kind": "sensor_back", "details": {"silent_s": 12}}


@pytest.mark.parametrize(
    ("before", "now", "events"),
    [
        ([SILENT], {"sensor_silent_s": 30}, []),
        ([SILENT], {}, [("sensor_back", "info")]),
        ([BACK, SILENT], {}, []),
        ([BACK, SILENT], {"sensor_silent_s": 30}, [("sensor_silent", "alarm")]),
        ([], {"sensor_silent_s": 30}, [("sensor_silent", "alarm")]),
    ],
)
def test_a_watch_that_begins_goes_on_from_what_was_told(before, now, events):
    """Events of before, the newest first."""
    watch = SensorWatch(lambda site, asset: before if asset == "beam" else ())
    assert told(watch, health(**now), health(**now)) == events


def test_losses_and_restarts_that_were_told_before_are_not_told_again():
    before = [
        {"kind": "samples_lost", "details": {"more": 8, "lost": 20, "dropped": 5}},
        {"kind": "samples_lost", "details": {"more": 12, "lost": 12, "dropped": 0}},
        {"kind": "source_restarted", "details": {"more": 1, "restarts": 4}},
    ]
    watch = SensorWatch(lambda site, asset: before)
    same = health(samples_lost=20, samples_dropped=5, source_restarts=4)
    assert told(watch, same) == []
    (lost,) = watch.hear([health(samples_lost=21, samples_dropped=5, source_restarts=4)], 0.0)
    assert lost.details["more"] == 1


def test_losses_that_a_narrow_counter_cannot_tell_are_named():
    (notice,) = SensorWatch().hear([health(samples_lost=3, samples_lost_unsure=256)], 0.0)
    assert "3 in all, and up to 256 that its counter is too narrow to tell." in notice.message
