"""Diagnoses by REST: ordered, told of, cancelled, adopted, undone; and the gap meanwhile."""

import pytest

from slowtime_schemas.answers.diagnoses import DiagnosisModel, GapModel
from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter
from twin_server.persist import DiagnosisRow, SqliteStore
from twin_server.settings import DiagnoseSettings, GapSettings

ENTERS, LEAVES = 1_000, 2_000


@pytest.fixture(scope="module")
def learnt(diagnosing):
    """The server, once it has learnt what is usual."""
    assert diagnosing.gap()["state"] == "waiting"
    diagnosing.learn()
    return diagnosing


def done(server, **order):
    answer = server.post("/diagnoses", {"raw": {"duration_s": 12.0}, **order})
    assert answer.status_code == 202, answer.text
    found = server.ended(answer.json()["number"])
    assert found["state"] == "done", found["error"]
    return found


@pytest.mark.long
def test_friction_opens_the_gap_and_what_is_adopted_closes_it_until_it_is_undone(learnt):
    usual = GapModel.model_validate(learnt.gap())
    assert usual.state == "watching"
    assert usual.expected is not None
    assert usual.limit is not None
    assert usual.expected < 0.05
    assert all(reading.in_use < usual.limit for reading in usual.readings)
    learnt.hear(3, first=ENTERS)
    assert learnt.gap()["state"] == "disagreeing"
    assert "disagreement" in learnt.kinds()

    number = done(learnt)["number"]
    assert learnt.post(f"/diagnoses/{number}/adopt").json()["adopted"]
    learnt.hear(3)
    closed = learnt.gap()
    assert closed["state"] == "watching"
    assert [r["disagrees"] for r in closed["readings"][-3:]] == [False] * 3
    assert all(r["nominal"] > 5 * r["in_use"] for r in closed["readings"][-3:])

    again = learnt.post(f"/diagnoses/{number}/adopt")
    assert (again.status_code, again.json()["type"][-15:]) == (409, "adopted-already")
    assert not learnt.post(f"/diagnoses/{number}/undo").json()["adopted"]
    learnt.hear(3)
    assert learnt.gap()["state"] == "disagreeing"
    order = ["gap_learnt", "disagreement", "diagnosed", "adopted", "agreement", "undone"]
    places = [learnt.kinds().index(kind) for kind in order]
    assert places == sorted(places)
    learnt.hear(3, first=LEAVES)
    assert learnt.gap()["state"] == "watching"


@pytest.mark.long
def test_what_is_adopted_is_part_of_the_registration_and_undone_leaves_no_trace(learnt):
    before = learnt.server.get(learnt.twin).json()["registration"]
    number = done(learnt)["number"]
    assert learnt.post(f"/diagnoses/{number}/adopt").status_code == 200
    adopted = learnt.server.get(learnt.twin).json()["registration"]
    assert [e["effect"] for e in adopted["model"]["effects"]] == ["coulomb"]
    (one,) = adopted["adopted"]
    assert (one["diagnosis"], one["effects"]) == (number, ["coulomb"])
    assert one["model_before"] == before["model"]
    second = done(learnt)["number"]
    assert learnt.post(f"/diagnoses/{second}/adopt").status_code == 200
    early = learnt.post(f"/diagnoses/{number}/undo")
    assert early.status_code == 409
    assert f"adopted last is: diagnosis {second}" in early.json()["detail"]
    for last in (second, number):
        assert learnt.post(f"/diagnoses/{last}/undo").status_code == 200
    assert learnt.server.get(learnt.twin).json()["registration"] == before


def test_a_diagnosis_tells_how_far_it_has_come_and_gives_its_files(learnt):
    answer = learnt.post("/diagnoses", {"raw": {"duration_s": 12.0}, "quick": True})
    job = DiagnosisModel.model_validate(answer.json())
    assert answer.headers["location"] == f"{learnt.twin}/diagnoses/{job.number}"
    stage = "refitting coulomb at element j2"
    assert learnt.until(lambda: learnt.one(job.number)["stage"] == stage)
    running = learnt.one(job.number)
    assert (running["state"], running["progress"]) == ("running", 0.4)
    none = learnt.server.get(f"{learnt.twin}/diagnoses/{job.number}/report.html")
    assert none.status_code == 404
    assert "which is running" in none.json()["detail"]
    waiting = learnt.post("/diagnoses", {"raw": {}}).json()["number"]
    full = learnt.post("/diagnoses", {"raw": {}})
    assert (full.status_code, full.json()["type"][-10:]) == (429, "over-quota")
    cancelled = learnt.server.client.delete(f"{learnt.twin}/diagnoses/{job.number}")
    assert cancelled.status_code == 202
    assert learnt.ended(job.number)["state"] == "cancelled"
    late = learnt.server.client.delete(f"{learnt.twin}/diagnoses/{job.number}")
    assert (late.status_code, late.json()["type"][-13:]) == (409, "ended-already")

    found = learnt.ended(waiting)
    assert found["report"]["sentence"] == "Dry friction in j2, 0.5 N."
    files = f"{learnt.twin}/diagnoses/{waiting}"
    page = learnt.server.get(f"{files}/report.html")
    assert "sandbox allow-scripts" in page.headers["content-security-policy"]
    assert "Dry friction" in page.text
    assert learnt.server.get(f"{files}/report.json").json() == found["report"]
    (chart,) = learnt.server.get(f"{files}/charts.json").json()["charts"]
    assert chart["heading"] == "Measured, and what the models say"
    assert chart["data"][0]["name"] == "measured"
    assert chart["words"] == "Acceleration of m1 (a1) <loud>"
    assert "coulomb" in learnt.server.get(f"{files}/augmented.yaml").text
    assert learnt.server.get(f"{files}/holdout.npz").status_code == 404
    listed = learnt.server.get(f"{learnt.twin}/diagnoses").json()["diagnoses"]
    assert [one["number"] for one in listed][:2] == [waiting, job.number]


BAD_BODIES = [
    ({}, 422, "Say where the samples come from"),
    ({"raw": {}, "recordings": {}}, 422, "one of them"),
    ({"clock": "slow", "raw": {}}, 422, "looks at the twin's history"),
    ({"raw": {"duration_s": -1}}, 422, "duration_s"),
    ({"raw": {"duration_s": 200.0}}, 422, "Allowed: up to 100"),
    ({"raw": {}, "holdout": {}, "holdout_s": 5.0}, 422, "Give one of them"),
    ({"raw": {}, "speed": 3}, 422, "speed"),
    ({"recordings": {"files": ["../secret.mcap"]}}, 422, "pattern"),
    ({"recordings": {"files": ["none.mcap"]}}, 422, "set diagnose.recordings to a folder"),
    ({"recordings": {"start": 5, "end": 4}}, 422, "is not before"),
    ({"recordings": {"start": "yesterday"}}, 422, "recordings"),
    ({"clock": "slow"}, 409, "0 epochs with an estimate"),
]


@pytest.mark.parametrize(("body", "status", "says"), BAD_BODIES)
def test_an_order_that_cannot_be_is_refused_with_the_cure(learnt, body, status, says):
    before = learnt.server.get(f"{learnt.twin}/diagnoses").json()["diagnoses"]
    answer = learnt.post("/diagnoses", body)
    assert (answer.status_code, says in answer.text) == (status, True), answer.text
    assert learnt.server.get(f"{learnt.twin}/diagnoses").json()["diagnoses"] == before


def test_what_has_named_nothing_is_not_adopted(learnt):
    number = done(learnt, holdout_s=3.0)["number"]
    answer = learnt.post(f"/diagnoses/{number}/adopt")
    assert answer.status_code == 409
    assert "found no effect: nothing missing" in answer.json()["detail"]
    assert learnt.post("/diagnoses/999/adopt").status_code == 404


def test_a_twin_without_model_edge_or_channel_is_told_of(diagnosing):
    client = diagnosing.server.client
    assert client.put("/api/v1/twins/lab.bare", json={}).status_code == 201
    answer = client.post("/api/v1/twins/lab.bare/diagnoses", json={"raw": {}})
    assert (answer.status_code, "has no model" in answer.text) == (409, True)
    assert diagnosing.server.get("/api/v1/twins/lab.bare/gap").json()["state"] == "off"
    model = diagnosing.server.get(diagnosing.twin).json()["registration"]["model"]
    body = {"changes": "stiffness", "model": model}
    assert client.put("/api/v1/twins/lab.away", json=body).status_code == 201
    answer = client.post("/api/v1/twins/lab.away/diagnoses", json={"raw": {}})
    assert (answer.status_code, "is away" in answer.text) == (409, True)
    model["inputs"][0]["channel"] = "hammer"
    assert client.put(diagnosing.twin, json=body | {"model": model}).status_code == 200
    answer = diagnosing.post("/diagnoses", {"raw": {}})
    assert (answer.status_code, "the model needs hammer" in answer.text) == (409, True)
    model["inputs"][0]["channel"] = "u"
    assert client.put(diagnosing.twin, json=body).status_code == 200


def test_what_was_under_way_when_the_server_died_has_failed(
    serving, pretender, eventually, tmp_path
):
    database = tmp_path / "twin.sqlite"
    quiet = GapSettings(every_s=0.0)
    first = serving(database, pretender, gap=quiet)
    first.client.put("/api/v1/twins/lab.rig", json={})
    first.stop.set()
    first.thread.join(60)
    store = SqliteStore(database)
    number = store.add_diagnosis(DiagnosisRow(0, "lab.rig", 1, None, "running", "{}"), 9)
    store.close()
    second = serving(database, pretender, gap=quiet)
    found = second.get(f"/api/v1/twins/lab.rig/diagnoses/{number}").json()
    assert found["state"] == "failed"
    assert "The server ended" in found["error"]


def test_recordings_that_the_server_keeps_may_be_named(
    serving, pretender, diagnosing, ageing, tmp_path
):
    with RecordingWriter(tmp_path / "monday.mcap") as writer:
        (message,) = ageing(1, asset="rig")
        writer.write(FEATURES, "lab", "rig", encode(message), message.t_ns)
    own = serving(
        diagnosis=pretender,
        gap=GapSettings(every_s=0.0),
        diagnose=DiagnoseSettings(recordings=tmp_path),
    )
    model = diagnosing.server.get(diagnosing.twin).json()["registration"]["model"]
    body = {"changes": "stiffness", "model": model}
    assert own.client.put("/api/v1/twins/lab.rig", json=body).status_code == 201
    for files in ([], ["monday.mcap"]):
        order = {"recordings": {"files": files, "start": "2026-01-01T00:00:00Z"}}
        answer = own.client.post("/api/v1/twins/lab.rig/diagnoses", json=order)
        assert answer.status_code == 202, answer.text
    answer = own.client.post(
        "/api/v1/twins/lab.rig/diagnoses", json={"recordings": {"files": ["tuesday.mcap"]}}
    )
    assert (answer.status_code, "that you may see: monday.mcap" in answer.text) == (422, True)
