"""The event that says that the model has changed, over a real server and a real database."""

import time

import numpy as np
import pytest

from slowtime_schemas.quantities import RENEWALS
from twin_server.estimate import DetectedChange
from twin_server.pipeline.monitoring import model_changes

TWIN = "/api/v1/twins/lab.beam"
BODY = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
AT = 40


@pytest.fixture
def jumping(ageing):
    """Features of a beam that loses twelve percent of its stiffness after `AT` epochs."""
    messages = ageing(AT, loss=0.0)
    for message in ageing(20, loss=0.0, first=AT, seed=1):
        mode = message.modes[0]
        value = mode.frequency_hz.value * float(np.sqrt(0.88))
        frequency = mode.frequency_hz.model_copy(update={"value": value})
        changed = mode.model_copy(update={"frequency_hz": frequency})
        messages.append(message.model_copy(update={"modes": (changed,)}))
    return messages


def told(server, twin=TWIN):
    found = server.get(f"{twin}/events", limit=1000).json()["events"]
    return [event for event in found if event["kind"] == "model_changed"]


def fed(server, messages, eventually):
    before = server.count()
    for message in messages:
        server.feed([message])
    assert eventually(lambda: server.count() == before + len(messages))


def test_a_jump_becomes_an_event_within_five_epochs_and_only_once(
    serving, jumping, eventually, tmp_path
):
    path = tmp_path / "twin.sqlite"
    server = serving(database=path)
    assert server.client.put(TWIN, json=BODY).status_code == 201
    fed(server, jumping[: AT + 5], eventually)
    assert eventually(lambda: told(server))
    (event,) = told(server)
    assert event["severity"] == "warning"
    assert event["details"]["quantity"] == "stiffness_change"
    assert event["details"]["since"] == AT - 1
    assert event["details"]["size"] == pytest.approx(-0.12, abs=0.01)
    assert "stiffness_change fell by 12" in event["message"]
    # The forecast learns anew at once, not when the next 25 readings are there.
    ahead = server.get(f"{TWIN}/forecast").json()
    assert ahead["jumps"] == {"stiffness_change": [AT - 1]}
    change = ahead["points"][0]["stiffness_change"]
    assert change["value"] == pytest.approx(-0.12, abs=0.02)
    assert change["hi"] < -0.08

    server.stop.set()
    server.thread.join(60)
    again = serving(database=path)
    fed(again, jumping[AT + 5 :], eventually)
    assert again.count() == len(jumping)
    assert told(again) == [event]


def test_a_twin_that_is_to_say_nothing_of_it_says_nothing(serving, jumping, eventually):
    server = serving()
    quiet = {"readings_between_false_alarms": None}
    assert server.client.put(TWIN, json={**BODY, "forecast": quiet}).status_code == 201
    fed(server, jumping, eventually)
    assert told(server) == []


@pytest.fixture
def unhurried(serving, jumping):
    """Start a server that has looked at two readings of some twins; the others come at once."""

    def start(*names, then=lambda: None):
        server = serving()
        every = [[m.model_copy(update={"asset": name}) for name in names] for m in jumping]
        for name in names:
            path = f"/api/v1/twins/lab.{name}"
            assert server.client.put(path, json=BODY).status_code == 201
        for number, messages in enumerate(every):
            server.feed(messages)
            if number < 2:
                time.sleep(1.0)
            if number == 0:
                then()
        return server

    return start


@pytest.mark.long
def test_while_features_wait_nobody_looks_and_nothing_is_missed_for_it(
    unhurried, eventually, monkeypatch
):
    """What was not kept to be looked at is in the history, however far back."""
    monkeypatch.setattr(model_changes, "WAITING", 3)
    server = unhurried("beam", then=lambda: monkeypatch.setattr(model_changes, "BUSY", -1))
    assert eventually(lambda: server.count() == AT + 20)
    time.sleep(1.0)
    assert told(server) == []
    monkeypatch.setattr(model_changes, "BUSY", 200)
    assert eventually(lambda: told(server))
    (event,) = told(server)
    assert event["details"]["since"] == AT - 1


@pytest.mark.long
def test_of_a_fleet_too_large_to_be_known_each_is_learnt_anew(
    unhurried, eventually, monkeypatch
):
    monkeypatch.setattr(model_changes, "MOST_WATCHED", 1)
    server = unhurried("beam", "mast")
    for twin in (TWIN, TWIN.replace("beam", "mast")):
        assert eventually(lambda twin=twin: told(server, twin))
    time.sleep(1.0)
    for twin in (TWIN, TWIN.replace("beam", "mast")):
        assert [event["details"]["since"] for event in told(server, twin)] == [AT - 1]


@pytest.mark.parametrize(
    ("quantity", "since", "told"),
    [
        ("stiffness", 20.0, True),
        ("stiffness", 19.0, True),
        ("stiffness", 22.0, True),
        ("stiffness", 24.0, False),
        ("stiffness", 12.0, False),
        ("mass", 20.0, False),
    ],
)
def test_a_change_read_again_from_elsewhere_is_told_once(quantity, since, told):
    found = DetectedChange(since=since, size=0.1, sd=0.01, odds=1e6)
    before = {("stiffness", 20.0), ("damping", since)}
    assert model_changes.was_told(before, quantity, found, since + 3.0) is told


def test_a_twin_that_is_made_anew_is_watched_anew(serving, jumping, eventually):
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    fed(server, jumping[: AT + 5], eventually)
    assert eventually(lambda: told(server))
    softer = {"nominal": {"frequency_hz": 2.9, "damping_ratio": 0.02}}
    assert server.client.put(TWIN, json=softer).is_success
    fed(server, jumping[AT + 5 :], eventually)
    time.sleep(1.0)
    assert len(told(server)) == 1


@pytest.mark.long
def test_a_jump_that_was_announced_as_a_renewal_is_no_sudden_change(
    serving, jumping, eventually
):
    server, other = serving(), "/api/v1/twins/lab.other"
    for twin in (TWIN, other):
        assert server.client.put(twin, json=BODY).status_code == 201
    announced = [
        one.model_copy(update={"covariates": {RENEWALS: float(one.sequence >= AT)}})
        for one in jumping
    ]
    fed(server, announced, eventually)
    # One twin is looked at after the other: once the second has its event, the first was.
    for one in jumping[: AT + 5]:
        server.feed([one.model_copy(update={"asset": "other"})])
    assert eventually(lambda: told(server, other))
    assert told(server) == []
    found = server.get(f"{TWIN}/events", limit=1000).json()["events"]
    assert [one["slow_time"] for one in found if one["kind"] == "renewed"] == [AT]
    # What is foretold follows from the renewed structure alone.
    ahead = server.get(f"{TWIN}/forecast").json()
    assert ahead["jumps"] == {"stiffness_change": []}
    assert ahead["points"][-1]["slow_time"] - ahead["since"] == pytest.approx(19 / 4)
    assert ahead["points"][0]["stiffness_change"]["hi"] < -0.08
