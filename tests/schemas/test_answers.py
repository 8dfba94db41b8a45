"""Answers of REST: what an older or a newer server says, and access by key."""

import pytest
from pydantic import ValidationError

from slowtime_schemas.answers.composites import AnyDependence
from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.risks import STATE_EXAMPLE, LimitStateRisk
from slowtime_schemas.answers.twins import STATE_EXAMPLE as READING
from slowtime_schemas.answers.twins import State


def test_words_and_fields_that_a_newer_server_adds_are_taken():
    found = LimitStateRisk.model_validate(STATE_EXAMPLE | {"kind": "fatigue", "added": 1})
    assert found.model_dump(include={"kind"}, warnings=False) == {"kind": "fatigue"}
    assert not hasattr(found, "added")
    with pytest.raises(ValidationError, match="kind"):
        LimitStateRisk.model_validate(STATE_EXAMPLE | {"kind": 1})


def test_a_choice_that_is_complete_takes_no_other_word():
    with pytest.raises(ValidationError, match="severity"):
        EventModel.model_validate({"severity": "fatal"})


def test_answers_are_immutable_and_states_know_their_time():
    state = State.model_validate(READING)
    assert state.time.isoformat() == "2026-11-21T04:00:00.123456+00:00"
    with pytest.raises(ValidationError, match="frozen"):
        state.valid = False  # type: ignore[misc]


def test_keys_of_former_dictionaries_work_and_warn():
    bounds = AnyDependence(lo=0.1, hi=0.2)
    with pytest.warns(DeprecationWarning, match=r"Write \.lo instead"):
        assert bounds["lo"] == 0.1
