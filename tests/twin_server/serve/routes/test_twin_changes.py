"""Changes of twins over REST and by the client: kept with author, refused, undone."""

import pytest

from slowtime_services.client import AnswerError, Client

TWIN = "/api/v1/twins/lab.beam"
ALARM = {"quantity": "stiffness_change", "below": -0.3}
COSTS = {"currency": "EUR", "failure": 9e5, "repair": 4e4, "inspection": 800.0}
DECISION = {"failure": {"quantity": "stiffness_change", "below": -0.4}, "horizon": 5.0}


@pytest.fixture(scope="module")
def beam(serving, ageing, eventually):
    """Start a server with a beam that has lost a fifth of its stiffness."""

    def start():
        return begun(serving(), ageing, eventually)

    return start


def begun(server, ageing, eventually):
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "alarms": [ALARM]}
    assert server.client.put(TWIN, json=body).status_code == 201
    server.feed(ageing(40))
    assert eventually(lambda: server.count() == 40)
    return server


@pytest.fixture
def house(beam):
    """A server of one test's own."""
    return beam()


@pytest.fixture(scope="module")
def still(beam):
    """A server whose registration no test changes."""
    return beam()


def registered(server):
    return server.get(TWIN).json()["registration"]


def test_a_change_is_kept_with_its_author_and_both_values_and_is_undone(house):
    client = Client(house.url)
    assert client.changes("lab.beam") == ()
    before = registered(house)
    told = client.change(
        "lab.beam",
        {"alarms": [ALARM | {"below": -0.15}]},
        before={"alarms": before["alarms"]},
        person="Ann",
        text="Owner's handbook.",
    )
    (one,) = told.changes
    assert (one.field, one.before) == ("alarms", before["alarms"])
    assert one.after == registered(house)["alarms"]
    assert one.after[0]["below"] == -0.15
    assert (told.person, told.principal, told.text) == (
        "Ann",
        "a local user",
        "Owner's handbook.",
    )
    event = next(e for e in client.events("lab.beam") if e.number == told.number)
    assert event.message == "Changed by Ann: alarms. Owner's handbook."
    # The history is estimated with the new alarm: it had been passed long before.
    assert house.get(TWIN).json()["raised"][0]["limit"] == -0.15

    undone = client.undo_change("lab.beam", told.number, person="Bob")
    assert registered(house) == before
    assert house.get(TWIN).json()["raised"] == []
    assert [(c.number, c.reverses, c.reversed_by) for c in client.changes("lab.beam")] == [
        (undone.number, told.number, None),
        (told.number, None, undone.number),
    ]
    again = client.undo_change("lab.beam", undone.number)
    assert registered(house)["alarms"][0]["below"] == -0.15
    assert [c.reversed_by for c in client.changes("lab.beam")] == [None, again.number, None]


def test_costs_are_changed_without_estimating_the_history_again(house):
    client = Client(house.url)
    states = house.get(f"{TWIN}/history/hash").json()
    seen = len(client.events("lab.beam"))
    client.change("lab.beam", {"costs": COSTS, "decision": DECISION})
    assert client.plan("lab.beam").currency == "EUR"
    assert house.get(f"{TWIN}/history/hash").json() == states
    assert len(client.events("lab.beam")) == seen + 1
    client.change("lab.beam", {"costs": COSTS | {"currency": "CHF"}})
    assert client.plan("lab.beam").currency == "CHF"


def test_registering_anew_is_a_change_as_well(house):
    body = registered(house) | {"name": "Beam 7", "learn_epochs": 30}
    assert house.client.put(TWIN, json=body).status_code == 200
    client = Client(house.url)
    (told,) = client.changes("lab.beam")
    assert [(c.field, c.before, c.after) for c in told.changes] == [("name", "", "Beam 7")]
    assert told.others == ("learn_epochs",)
    with pytest.raises(AnswerError, match=r"It changed learn_epochs too.*undone: none"):
        client.undo_change("lab.beam", told.number)


@pytest.mark.parametrize(
    ("body", "status", "match"),
    [
        ({}, 422, "neither was given"),
        ({"after": {"name": "x"}, "reverses": 1}, 422, "both was given"),
        ({"reverses": 1, "before": {"name": ""}}, 422, "before was given with reverses"),
        ({"after": {"model": None}}, 422, "alarms"),
        ({"after": {"repair": None}}, 422, "repair, which is no field of a registration"),
        ({"after": {"name": "x"}, "event": "r1"}, 422, "name, which is no field of a recorded"),
        ({"after": {"text": "x"}, "event": "r1", "before": {"name": ""}}, 422, "with event"),
        ({"reverses": 1, "event": "r1"}, 422, "event was given with reverses"),
        ({"after": {"text": "x"}, "event": "r1"}, 409, "At body.event, r1 was given"),
        ({"after": {"name": "x"}, "before": {"name": "y"}}, 409, "has changed name of"),
        ({"after": {"name": ""}}, 409, "has these values already"),
        ({"reverses": 99}, 409, "99 was given"),
        ({"after": {"alarms": [{"quantity": "k9", "below": -0.1}]}}, 422, "An alarm on 'k9'"),
        ({"after": {"decision": DECISION}}, 422, "A decision was given without costs"),
        ({"after": {"alarm_routes": [{"receiver": "nobody"}]}}, 422, "nobody"),
    ],
)
def test_what_is_not_valid_is_refused_with_what_to_do(still, body, status, match):
    before = registered(still)
    answer = still.client.post(f"{TWIN}/changes", json=body)
    assert (answer.status_code, match in answer.text) == (status, True), answer.text
    assert registered(still) == before


def test_a_change_that_was_overtaken_is_not_undone(house):
    client = Client(house.url)
    first = client.change("lab.beam", {"name": "A"})
    second = client.change("lab.beam", {"name": "B"})
    with pytest.raises(AnswerError, match=r"Somebody has changed name of lab\.beam meanwhile"):
        client.undo_change("lab.beam", first.number)
    client.undo_change("lab.beam", second.number)
    client.undo_change("lab.beam", first.number)
    assert registered(house)["name"] == ""


def test_no_twin_no_change(still):
    path = "/api/v1/twins/lab.none/changes"
    assert still.client.post(path, json={"after": {"name": "x"}}).status_code == 404
    assert still.get(path).status_code == 404
