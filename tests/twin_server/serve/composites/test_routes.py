"""Composites over REST: registered, related, refused, kept."""

import pytest

from .conftest import IDS, LINE


def test_relations_are_asked_for_both_ways(idle):
    members = idle.get("/api/v1/composites/lab.yard/members").json()
    assert members["members"][0] == {"id": "lab.line", "kind": "line"}
    assert set(members["twins"]) == set(IDS)
    found = idle.get(f"/api/v1/twins/{IDS[0]}/memberships").json()
    assert (found["composites"], found["above"]) == (["lab.line"], ["lab.line", "lab.yard"])
    every = idle.get("/api/v1/composites").json()["composites"]
    assert [one["id"] for one in every] == ["lab.line", "lab.yard"]
    assert every[1]["health"]["twins"] == 12


def test_former_registrations_are_kept(idle):
    changed = {**LINE, "name": "Other"}
    assert idle.client.put("/api/v1/composites/lab.line", json=changed).status_code == 200
    assert idle.client.put("/api/v1/composites/lab.line", json=changed).status_code == 200
    assert idle.client.put("/api/v1/composites/lab.line", json=LINE).status_code == 200
    found = idle.get("/api/v1/composites/lab.line/revisions").json()["revisions"]
    assert [one["registration"]["name"] for one in found] == ["", "Other", ""]


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "says"),
    [
        ("PUT", "composites/lab.beam-1", {"members": [IDS[0]]}, 422, "is a twin already"),
        (
            "PUT",
            "composites/lab.x",
            {"members": ["lab.none"]},
            422,
            "neither a twin nor a comp",
        ),
        ("PUT", "composites/lab.line", {"members": ["lab.yard"]}, 422, "cannot contain itself"),
        ("PUT", "composites/lab.x", {"members": [IDS[0]], "tree": {"or": []}}, 422, "or"),
        ("PUT", "twins/lab.line", {}, 409, "lab.line is a composite"),
        ("DELETE", "composites/lab.line", None, 409, "is a member of lab.yard"),
        ("GET", "composites/lab.none", None, 404, "Registered: lab.line, lab.yard"),
        ("GET", "composites/lab.none/members", None, 404, "No composite"),
        ("GET", "composites/lab.line?horizon=-1", None, 422, "horizon"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(idle, method, path, body, status, says):
    answer = idle.client.request(method, f"/api/v1/{path}", json=body)
    assert answer.status_code == status
    assert says in answer.text


def test_a_composite_survives_a_restart(serving, tmp_path):
    path = tmp_path / "twin.sqlite"
    first = serving(database=path)
    assert first.client.put("/api/v1/twins/lab.beam", json={}).status_code == 201
    body = {"members": ["lab.beam"], "name": "Kept"}
    assert first.client.put("/api/v1/composites/lab.kept", json=body).status_code == 201
    assert first.client.put("/api/v1/composites/lab.gone", json=body).status_code == 201
    assert first.client.delete("/api/v1/composites/lab.gone").status_code == 204
    first.stop.set()
    first.thread.join(60)
    second = serving(database=path)
    (one,) = second.get("/api/v1/composites").json()["composites"]
    assert one["name"] == "Kept"
    assert second.client.delete("/api/v1/twins/lab.beam").status_code == 204
    told = second.get("/api/v1/composites/lab.kept").json()
    assert told["failure"]["reasons"] == ["lab.beam is not registered any more."]
    assert told["health"]["valid"] is False
