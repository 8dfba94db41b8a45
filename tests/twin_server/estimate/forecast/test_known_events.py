"""Events that were told are placed among readings, and become what they do to each quantity."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.evolution.events.known_events import (
    NOMINAL_SD,
    UNKNOWN_SHARE,
    Detection,
    Measurement,
    Repair,
    Replacement,
)
from slowtime_schemas.asset_events import AssetEvent
from twin_server.estimate.forecast.known_events import come_after, jump_times, known_of, place
from twin_server.events.asset_events import effective
from twin_server.history.states import blank

T_NS = np.arange(10, dtype=np.int64) * 100
SLOW = np.arange(10.0) / 2.0
BOTH = ("stiffness_change", "mass_change")
LAW = {"a50": 0.1, "slope": 2.0}


def told(kind="repair", name="e1", **more):
    when = {} if {"happened_ns", "slow_time"} & more.keys() else {"happened_ns": 450}
    return AssetEvent.model_validate(
        {
            "site": "lab", "asset": "beam", "boot": "twin", "sequence": 1, "t_ns": 5,
            "event": name, "kind": kind, "person": "Ann", **when, **more,
        }
    )  # fmt: skip


@given(at=st.integers(0, 2_000))
def test_an_event_stands_after_the_last_reading_at_or_before_it(at):
    expected = max(
        slow for t, slow in zip(T_NS.tolist(), SLOW.tolist(), strict=True) if t <= at
    )
    assert place(told(happened_ns=at), T_NS, SLOW) == expected
    assert place(told(slow_time=at / 200.0), T_NS, SLOW) == expected


def test_an_event_before_all_readings_is_left_out():
    assert place(told(slow_time=-0.1), T_NS, SLOW) is None
    assert known_of([told(slow_time=-0.1)], T_NS, SLOW, BOTH) == {}


def test_each_kind_becomes_its_effect():
    part = {"change": -0.1, "sd": 0.03}
    events = [
        told(name="r1"),
        told(name="r2", repair={"restored_share": 1.0}),
        told(name="r3", repair={"restored_share": 0.6, "restored_share_sd": 0.1}),
        told("replacement", "p1"),
        told("replacement", "p2", replacement={"change": None}),
        told("replacement", "p3", replacement=part),
        told("inspection", "i1", measured={"value": -0.2, "sd": 0.05}),
        told(
            "inspection", "i2",
            detection={"detected": True, "probability_of_detection": LAW},
        ),
        told("load_test", "l1"),
        told("note", "n1"),
    ]  # fmt: skip
    found = known_of(events, T_NS, SLOW, ["stiffness_change"])["stiffness_change"]
    share, sd = UNKNOWN_SHARE
    assert found[:7] == (
        Repair(time=2.0, share=share, share_sd=sd),
        Repair(time=2.0),
        Repair(time=2.0, share=0.6, share_sd=0.1),
        Replacement(time=2.0, level=0.0, level_sd=NOMINAL_SD),
        Replacement(time=2.0, level=None, level_sd=NOMINAL_SD),
        Replacement(time=2.0, level=-0.1, level_sd=0.03),
        Measurement(time=2.0, value=-0.2, sd=0.05),
    )
    assert isinstance(found[7], Detection)
    assert (found[7].curve.a50, found[7].detected, len(found)) == (0.1, True, 8)
    assert jump_times({"stiffness_change": found}) == {"stiffness_change": [2.0] * 6}


def test_an_event_concerns_the_quantity_that_it_names_or_all():
    repair = told(quantity="mass_change")
    assert set(known_of([repair], T_NS, SLOW, BOTH)) == {"mass_change"}
    assert set(known_of([told()], T_NS, SLOW, BOTH)) == set(BOTH)
    scan = told("inspection", detection={"detected": False, "probability_of_detection": LAW})
    assert set(known_of([scan], T_NS, SLOW, BOTH)) == {"stiffness_change"}


def test_what_was_taken_back_has_no_effect():
    events = [told(name="a"), told("note", "b", reverses="a"), told(name="c")]
    assert [event.event for event in effective(events)] == ["c"]


@pytest.mark.parametrize(
    ("first", "after"), [(5, True), (4, False)], ids=["later", "of-before"]
)
def test_readings_of_before_an_event_place_it_anew(first, after):
    states = blank(2)
    states["t_ns"], states["slow_time"] = T_NS[first : first + 2], SLOW[first : first + 2]
    assert come_after(states, [told(happened_ns=450)]) is after
    assert come_after(states, [told(slow_time=2.25)]) is after
    assert come_after(blank(0), [told()])
