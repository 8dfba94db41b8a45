"""The event that says that the model has changed, over a real server and a real database."""

import numpy as np
import pytest

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


def told(server):
    found = server.get(f"{TWIN}/events", limit=1000).json()["events"]
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
    assert "stiffness_change went elsewhere after slow time 39, by −12" in event["message"]
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
