"""What is written by hand must be what the schemas say, whatever the numbers."""

import json

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime_schemas.answers.twins import State
from slowtime_schemas.messages import Event, TwinState
from twin_server.history import states as rows
from twin_server.history.rendering import (
    event_body,
    event_object,
    points,
    state_messages,
    state_objects,
)

numbers = st.floats(allow_nan=False, allow_infinity=False)
estimates = st.none() | st.tuples(numbers, st.floats(0, 1e300), numbers, numbers)


@st.composite
def states(draw):
    state = rows.blank(1)
    state["sequence"], state["t_ns"] = draw(st.integers(0, 2**40)), draw(st.integers(0, 2**62))
    state["slow_time"] = draw(numbers)
    for name in rows.ESTIMATES:
        estimate = draw(estimates)
        if estimate is not None:
            state[name] = estimate
    state["truth"] = draw(st.tuples(*[numbers | st.just(np.nan)] * 4))
    state["correlation"] = draw(st.floats(-1, 1))
    state["notes"] = draw(st.integers(0, 7))
    state["reasons"] = draw(st.sampled_from([0, 1, 520, rows.NO_MODE, rows.LEARNING | 8]))
    return state


@settings(max_examples=200, deadline=None)
@given(state=states(), unit=st.text(min_size=1, max_size=5))
def test_a_state_is_the_message_and_the_model_it_claims_to_be(state, unit):
    (message,) = state_messages(state, [("lab", "beam")], ["b1"], [unit])
    decoded = TwinState.model_validate_json(message, strict=True)
    (text,) = state_objects(state, "lab.beam", ["b1"], [unit])
    shown = State.model_validate_json(text)
    for model in (decoded, shown):
        assert model.slow_time == state["slow_time"][0]
        assert model.slow_time_unit == unit
        assert model.valid is bool(state["reasons"][0] == 0)
        said = rows.sentences(int(state["reasons"][0]))
        assert len(model.reasons) == len(said)
        assert all(
            w.startswith(r) and r[-1] == "." for w, r in zip(said, model.reasons, strict=True)
        )
        assert model is decoded or tuple(model.reasons) == said
        for name in rows.ESTIMATES:
            estimate = getattr(model, name)
            expected = state[name][0]
            if np.isnan(expected[0]):
                assert estimate is None
            else:
                assert (estimate.value, estimate.sd, estimate.lo, estimate.hi) == tuple(
                    expected
                )
    assert list(json.loads(text))[:3] == ["id", "t_ns", "slow_time"]


def test_an_empty_history_is_a_history():
    assert json.loads(points(iter(()))) == {"points": []}


def test_an_event_is_shown_with_its_number_and_its_twin():
    event = Event(
        site="lab", asset="beam", boot="b1", sequence=4, t_ns=9, kind="alarm",
        severity="alarm", message="It moved.",
    )  # fmt: skip
    shown = event_object(7, event_body(event))
    assert (shown["number"], shown["id"], shown["message"]) == (7, "lab.beam", "It moved.")
    assert not {"version", "site", "asset"} & set(shown)


def test_every_bit_of_reasons_has_a_sentence_with_a_cure():
    for bit in (rows.NO_MODE, rows.LEARNING, rows.NO_DAMPING, rows.NOT_REPRESENTABLE):
        (sentence,) = rows.sentences(bit)
        assert sentence.count(".") >= 2
    assert len(rows.sentences(rows.NO_MODE | 1 | 8)) == 3


def test_the_layout_of_a_state_is_what_databases_hold():
    # Another number here needs another LAYOUT, or old databases are read wrongly.
    assert rows.LAYOUT == 1
    assert rows.STATE.itemsize == 208
    assert rows.STATE.names == (
        "sequence", "t_ns", "slow_time", "frequency_hz", "damping_ratio", "stiffness_change",
        "mass_change", "correlation", "truth", "missing_before", "reasons", "notes",
    )  # fmt: skip
