"""Events of assets over REST and by the client: recorded once, listed, taken back, answered."""

import pytest

from slowtime_schemas.asset_events import Correction
from slowtime_services.client import AnswerError, Client

TWIN = "/api/v1/twins/lab.beam"
BODY = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
REPAIR = {"event": "r1", "kind": "repair", "repair": {"restored_share": 1.0}, "person": "Ann"}
AT = 40


@pytest.fixture(scope="module")
def house(serving, ageing, eventually):
    """A server with a beam that has lost a fifth of its stiffness."""
    server = serving()
    server.client.put(TWIN, json=BODY)
    server.feed(ageing(60))
    assert eventually(lambda: server.count() == 60)
    return server


def change_ahead(client):
    """Change of stiffness at the next reading, as it is foretold."""
    change = client.forecast("lab.beam").points[0].stiffness_change
    assert change is not None
    return change


def test_an_event_is_recorded_once_and_taken_back(house):
    client = Client(house.url)
    before = change_ahead(client)
    answer = house.client.post(f"{TWIN}/events", json=REPAIR)
    assert answer.status_code == 201, answer.text
    told = answer.json()
    assert (told["slow_time"], told["person"]) == (59.0, "Ann")
    assert told["sentence"] == "Repair recorded by Ann: perfect, all damage restored."
    again = house.client.post(f"{TWIN}/events", json=REPAIR)
    assert (again.status_code, again.json()) == (200, told)
    other = house.client.post(f"{TWIN}/events", json=REPAIR | {"text": "x"})
    assert (other.status_code, other.json()["type"]) == (
        409,
        "urn:slowtime:problem:another-event",
    )
    after = change_ahead(client)
    assert before.value < -0.19 < -0.05 < after.value
    events = client.events("lab.beam")
    (said,) = [event for event in events if event.kind == "asset_event"]
    assert said.details["event"] == "r1"
    assert said.details["by"] == "Ann"
    undone = client.undo_event("lab.beam", "r1", person="Bob", text="Another beam.")
    assert undone.sentence == "Bob took back the event r1. Another beam."
    assert client.undo_event("lab.beam", "r1", person="Bob", text="Another beam.") == undone
    assert change_ahead(client) == before
    listed = client.recorded_events("lab.beam")
    assert [(one.event, one.reversed_by) for one in listed.events] == [
        ("undo-r1", None),
        ("r1", "undo-r1"),
    ]
    with pytest.raises(AnswerError, match="r1 was taken back by undo-r1 already"):
        client.undo_event("lab.beam", "r1", name="again")


@pytest.mark.parametrize(
    ("body", "match"),
    [
        ({"event": "x", "kind": "inspection"}, "An inspection has one result"),
        ({"event": "x", "kind": "note", "repair": {}}, "repair was given with kind 'note'"),
        ({"event": "x", "kind": "repair", "reverses": "r1"}, "reverses was given with kind"),
        ({"event": "a b", "kind": "note"}, "event"),
        ({"event": "x", "kind": "note", "at": "0001-01-01T00:00:00Z"}, "before 1970"),
        ({"event": "x", "kind": "note", "at": "9999-12-31T00:00:00Z"}, "in the future"),
        ({"event": "x", "kind": "note", "slow_time": 99.0}, "Allowed: up to 59"),
        ({"event": "x", "kind": "note", "at": 1, "slow_time": 1.0}, "Give one of them"),
        ({"event": "x", "kind": "note", "quantity": "j7"}, "j7 was given. Allowed for lab"),
        (
            {
                "event": "x", "kind": "inspection",
                "detection": {
                    "detected": True,
                    "probability_of_detection": {
                        "points": [
                            {"damage": 0.2, "probability": 0.5},
                            {"damage": 0.1, "probability": 0.9},
                        ]
                    },
                },
            },
            "ascend in damage",
        ),
    ],
)  # fmt: skip
def test_what_is_not_valid_is_refused_with_what_to_do(house, body, match):
    answer = house.client.post(f"{TWIN}/events", json=body)
    assert answer.status_code in (409, 422)
    assert match in answer.text
    assert answer.headers["content-type"] == "application/problem+json"


def test_no_twin_no_event(house):
    path = "/api/v1/twins/lab.none/events"
    assert house.client.post(path, json=REPAIR).status_code == 404
    assert house.get(f"{path}/recorded").status_code == 404


@pytest.mark.parametrize("told", [True, False], ids=["told", "untold"])
def test_a_repair_is_asked_about_where_nobody_has_told_of_it(serving, ageing, eventually, told):
    server = serving()
    server.client.put(TWIN, json=BODY)
    client = Client(server.url)
    for message in ageing(AT):
        server.feed([message])
    assert eventually(lambda: server.count() == AT)
    if told:
        client.record_event("lab.beam", REPAIR)
    # A second twin, of whose repair nobody tells, says when both were looked at.
    other = "/api/v1/twins/lab.mast"
    server.client.put(other, json=BODY)
    later = ageing(5, loss=0.0, first=AT, seed=1)
    server.feed(later)
    server.feed([one.model_copy(update={"asset": "mast"}) for one in [*ageing(AT), *later]])
    assert eventually(lambda: client.recorded_events("lab.mast").questions)
    if told:
        assert client.recorded_events("lab.beam").questions == ()
        kinds = {event.kind for event in client.events("lab.beam")}
        assert kinds & {"model_changed", "repair_suspected"} == set()
        return
    assert eventually(lambda: client.recorded_events("lab.beam").questions)
    (question,) = client.recorded_events("lab.beam").questions
    assert (question.since, question.answered_by) == (AT - 1.0, None)
    answer = {"event": "n1", "kind": "note", "answers": question.event_id, "text": "Frost."}
    client.record_event("lab.beam", answer)
    assert client.recorded_events("lab.beam").questions[0].answered_by == "n1"


def test_a_correction_is_one_step_with_history_and_undo(serving, ageing, eventually):
    server = serving()
    server.client.put(TWIN, json=BODY)
    server.feed(ageing(60))
    assert eventually(lambda: server.count() == 60)
    client = Client(server.url)
    client.record_event("lab.beam", REPAIR | {"text": "Bolts."})
    # Which of two events after one reading comes first matters to the forecast.
    found = {"measured": {"value": -0.05, "sd": 0.02}}
    client.record_event("lab.beam", {"event": "i1", "kind": "inspection", **found})
    before = change_ahead(client)
    share = {"restored_share": 0.5, "restored_share_sd": 0.1}
    told = client.change(
        "lab.beam", {"repair": share}, event="r1", person="Bob", text="Half of the bolts."
    )
    assert (told.event, told.recorded_as, told.reverses) == ("r1", "r1.2", None)
    assert (told.person, told.principal) == ("Bob", "a local user")
    (one,) = told.changes
    assert one.field == "repair"
    assert (one.before["restored_share"], one.after) == (1.0, share)
    assert change_ahead(client) != before
    r2, i1, r1 = client.recorded_events("lab.beam").events
    assert r2.sentence == (
        "Repair recorded by Bob: 50 % ± 10 % of the damage restored. Bolts. "
        "Corrects the event r1: Half of the bolts."
    )
    assert r2.corrects == Correction(event="r1", text="Half of the bolts.")
    assert (r2.event, r2.reversed_by) == ("r1.2", None)
    assert (r2.slow_time, i1.reversed_by, r1.reversed_by) == (59.0, None, "r1.2")
    said = [event for event in client.events("lab.beam") if event.kind == "asset_event"]
    assert said[-1].number == told.number

    # Only what holds is corrected, and only to something else.
    with pytest.raises(AnswerError, match=r"r1 was corrected by Bob as r1\.2 already"):
        client.change("lab.beam", {"repair": None}, event="r1")
    with pytest.raises(AnswerError, match=r"r1 was corrected by Bob as r1\.2 already"):
        client.undo_event("lab.beam", "r1")
    with pytest.raises(AnswerError, match=r"r1\.2 says this already"):
        client.change("lab.beam", {"repair": share, "text": "Bolts."}, event="r1.2")
    for after, match in (
        ({"repair": {"restored_share": 2}}, r"At body\.after\.repair\.restored_share"),
        ({"kind": "inspection"}, "repair was given with kind 'inspection'"),
        ({"quantity": "j7"}, r"At body\.after\.quantity, j7 was given"),
        ({"slow_time": 99.0}, r"At body\.after\.slow_time, 99 was given"),
    ):
        with pytest.raises(AnswerError, match=match):
            client.change("lab.beam", after, event="r1.2")
    assert len(client.recorded_events("lab.beam").events) == 3

    undone = client.undo_change("lab.beam", told.number, person="Cy")
    assert change_ahead(client) == before
    assert (undone.event, undone.recorded_as) == ("r1.2", "r1.3")
    assert [(c.number, c.reverses, c.reversed_by) for c in client.changes("lab.beam")] == [
        (undone.number, told.number, None),
        (told.number, None, undone.number),
    ]
    with pytest.raises(AnswerError, match=r"r1\.2 was corrected by Cy as r1\.3 already"):
        client.undo_change("lab.beam", told.number)
    # Another kind, another time: a part that does not go with it is left out.
    note = {"kind": "note", "repair": None, "slow_time": 12.5}
    told = client.change("lab.beam", note, event="r1.3")
    assert [one.field for one in told.changes] == ["kind", "at", "slow_time", "repair"]
    assert client.recorded_events("lab.beam").events[0].slow_time == 12.5
    client.undo_event("lab.beam", "r1.4")
    listed = client.recorded_events("lab.beam").events
    assert [e.event for e in listed if e.reversed_by is None] == ["undo-r1.4", "i1"]
