"""REST as others script against it."""

import re
import socket
from urllib.parse import quote

import numpy as np
import pytest

from slowtime_schemas.answers.forecasts import ForecastModel
from slowtime_schemas.answers.history import EventList, HistoryModel
from slowtime_schemas.answers.twins import ModesModel, State
from slowtime_services.clock import SystemClock
from twin_server.collect.refusals import REASONS
from twin_server.serve.routes.twins import TwinModel

TWIN = "/api/v1/twins/lab.beam"


def test_the_list_shows_each_twin_with_its_latest_state(server):
    (twin,) = server.get("/api/v1/twins").json()["twins"]
    TwinModel.model_validate(twin)
    State.model_validate({k: twin[k] for k in State.model_fields if k in twin})
    assert twin["id"] == "lab.beam"
    assert twin["slow_time"] == 299.0
    assert twin["registration"]["name"] == "Beam"
    assert twin["nominal"]["frequency_hz"] == 3.0
    assert twin["valid"] is True


def test_history_holds_every_state_in_order(server):
    found = HistoryModel.model_validate(server.get(f"{TWIN}/history").json())
    assert [p.sequence for p in found.points] == list(range(300))
    held = []
    for point in found.points:
        assert point.stiffness_change is not None
        assert point.truth is not None
        true = point.truth["stiffness_change"]
        held.append(point.stiffness_change.lo <= true <= point.stiffness_change.hi)
    assert 0.91 < np.mean(held) < 0.99


@pytest.mark.parametrize("max_points", [2, 7, 50, 299])
def test_fewer_points_hide_no_extreme(server, max_points):
    every = server.get(f"{TWIN}/history").json()["points"]
    some = server.get(f"{TWIN}/history", max_points=max_points).json()["points"]
    assert len(some) <= max_points
    assert some[0] == every[0]
    assert some[-1] == every[-1]
    assert [p["sequence"] for p in some] == sorted(p["sequence"] for p in some)
    if max_points >= 50:
        for quantity in ("frequency_hz", "stiffness_change"):
            for end, extreme in (("lo", min), ("hi", max), ("value", min), ("value", max)):
                values = [p[quantity][end] for p in some]
                assert extreme(values) == extreme(p[quantity][end] for p in every)


@pytest.mark.parametrize("max_points", [2, 12, 50])
def test_a_thinned_history_tells_what_all_readings_show(server, max_points):
    every = server.get(f"{TWIN}/history").json()
    assert "bands" not in every
    found = server.get(f"{TWIN}/history", max_points=max_points).json()
    bands = HistoryModel.model_validate(found).bands
    assert bands is not None
    assert bands.readings == sum(bands.count) == 300
    assert sum(bands.valid) == sum(p["valid"] for p in every["points"])
    assert len(bands.count) <= max(1, max_points // 2)
    ends = zip(bands.start.slow_time, bands.end.slow_time, bands.count, strict=True)
    for number, (start, end, count) in enumerate(ends):
        part = every["points"][int(start) : int(end) + 1]
        assert len(part) == count
        for name in ("frequency_hz", "stiffness_change"):
            band, told = bands.quantities[name], [p[name] for p in part]
            assert band.min[number] == min(one["value"] for one in told)
            assert band.max[number] == max(one["value"] for one in told)
            assert band.lo[number] == min(one["lo"] for one in told)
            assert band.hi[number] == max(one["hi"] for one in told)
            assert band.mean[number] == pytest.approx(np.mean([one["value"] for one in told]))
        true = [p["truth"]["stiffness_change"] for p in part]
        assert bands.truth["stiffness_change"].min[number] == min(true)
        assert bands.truth["stiffness_change"].max[number] == max(true)


@pytest.mark.parametrize(
    ("span", "sequences"),
    [
        ({"start": "slow:10", "end": "slow:12"}, [10, 11, 12]),
        ({"start": "2026-01-01T00:00:10Z", "end": "1767225611000000000"}, [10, 11]),
        ({"end": "slow:1.5"}, [0, 1]),
        ({"start": "slow:298.5"}, [299]),
        ({"start": "slow:400"}, []),
        ({"start": "slow:5", "end": "slow:4"}, []),
    ],
)
def test_history_is_cut_where_it_is_asked_for(server, span, sequences):
    points = server.get(f"{TWIN}/history", **span).json()["points"]
    assert [p["sequence"] for p in points] == sequences


def test_a_twin_as_it_was(server):
    assert server.get(TWIN, at="slow:41.7").json()["sequence"] == 41
    assert server.get(TWIN, at="2026-01-01T00:01:00Z").json()["sequence"] == 60
    before = server.get(TWIN, at="2020-01-01T00:00:00Z").json()
    assert before["valid"] is False
    assert before["stiffness_change"] is None
    assert "no features at that moment" in before["reasons"][0]


@pytest.mark.long
def test_the_forecast_goes_on_where_the_history_ends(server):
    found = server.get(f"{TWIN}/forecast", horizon=30, points=3).json()
    ForecastModel.model_validate(found)
    assert [p["slow_time"] for p in found["points"]] == [309.0, 319.0, 329.0]
    assert found["points"][0]["mass_change"] is None
    last = found["points"][-1]["stiffness_change"]
    assert last["lo"] < -0.2 * 329 / 300 < last["hi"]
    assert server.get(f"{TWIN}/forecast").json()["points"]


def test_the_forecast_says_when_a_threshold_is_reached(server):
    found = server.get(f"{TWIN}/forecast", threshold=-0.3, horizon=300).json()
    ForecastModel.model_validate(found)
    (crossing,) = found["crossings"]
    assert crossing["quantity"] == "stiffness_change"
    assert crossing["source"] == "request"
    shares = [time["share"] for time in crossing["times"]]
    assert shares == [0.1, 0.5, 0.9]
    median = crossing["times"][1]
    assert median["slow_time"] == pytest.approx(450.0, abs=60.0)
    assert median["ahead"] == pytest.approx(median["slow_time"] - 299.0)
    assert crossing["sentence"].startswith("Stiffness change at −30 %: 10 %: by 4")
    never = server.get(f"{TWIN}/forecast", threshold=-0.9, horizon=10).json()["crossings"][0]
    assert [time["slow_time"] for time in never["times"]] == [None] * 3
    assert "not within the horizon of 309" in never["sentence"]
    assert server.get(f"{TWIN}/forecast").json()["crossings"] == []


def test_thresholds_of_alarms_and_of_the_registration_are_asked_for_each_time(
    serving, ageing, eventually
):
    own = serving()
    limits = {
        "alarms": [{"quantity": "stiffness_change", "below": -0.02}],
        "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.5}]},
    }
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, **limits}
    assert own.client.put(TWIN, json=body).status_code == 201
    own.feed(ageing(40))
    assert eventually(lambda: own.count() == 40)
    asked = own.get(f"{TWIN}/forecast", threshold=-0.1).json()["crossings"]
    assert [one["source"] for one in asked] == ["request", "alarm", "registration"]
    assert [one["threshold"] for one in asked] == [-0.1, -0.02, -0.5]
    assert asked[1]["toward"] == "below"
    wrong = {**body, "forecast": {"thresholds": [{"quantity": "mass", "at": 0.1}]}}
    refused = own.client.put(TWIN, json=wrong)
    assert refused.status_code == 422
    assert "Allowed: frequency_hz" not in refused.text
    assert "Allowed: stiffness_change, mass_change" in refused.text


@pytest.mark.long
def test_a_forecast_after_a_restart_is_the_one_that_would_have_been(
    serving, ageing, tmp_path, eventually
):
    path = tmp_path / "twin.sqlite"
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    first = serving(database=path)
    assert first.client.put(TWIN, json=body).status_code == 201
    messages = ageing(70)
    first.feed(messages[:55])
    assert eventually(lambda: first.count() == 55)
    assert first.get(f"{TWIN}/forecast").json()["points"]
    first.feed(messages[55:])
    assert eventually(lambda: first.count() == 70)
    before = first.get(f"{TWIN}/forecast", threshold=-0.1).json()
    first.stop.set()
    first.thread.join(60)
    again = serving(database=path)
    assert again.get(f"{TWIN}/forecast", threshold=-0.1).json() == before


def test_events_from_the_first_or_from_a_number_on(server):
    found = server.get(f"{TWIN}/events").json()
    EventList.model_validate(found)
    assert [e["kind"] for e in found["events"]] == ["registered"]
    number = found["events"][-1]["number"]
    assert server.get(f"{TWIN}/events", after=number).json() == {"events": []}


def test_the_hash_names_how_many_features_it_is_of(server):
    found = server.get(f"{TWIN}/history/hash").json()
    assert found["features"] == 300
    assert len(found["sha256"]) == 64


def test_health_readiness_and_metrics(server):
    assert server.get("/healthz").json() == {"status": "ok"}
    assert server.get("/readyz").json() == {"status": "ok"}
    answer = server.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    lines = answer.text.splitlines()
    assert "slowtime_twin_accepted_total 300" in lines
    assert "slowtime_twin_twins 1" in lines
    said = {line.split('"')[1] for line in lines if line.startswith("slowtime_twin_refused_t")}
    assert said == set(REASONS)
    for line in lines:
        name = line.split("{")[0].split(" ")[0]
        assert line.startswith("#") or f"# TYPE {name} " in answer.text


PROBLEMS = [
    ("GET", "/api/v1/twins/lab.nobody", 404, "no-such-twin", "Registered: lab.beam"),
    ("GET", "/api/v1/twins/lab.nobody/live", 404, "no-such-twin", "Register it with PUT"),
    ("DELETE", "/api/v1/twins/lab.nobody", 404, "no-such-twin", "Register it with PUT"),
    ("GET", "/api/v1/nowhere", 404, "no-such-address", "openapi.json"),
    ("GET", "/assets/../settings.py", 404, "no-such-address", "does not exist"),
    ("GET", "/assets/nothing.js", 404, "no-such-address", "Allowed: acknowledging.js, app-"),
    ("POST", "/api/v1/twins", 405, "method-not-allowed", "Allowed: GET"),
    ("GET", "/api/v1/twins/Not-An-Id", 422, "not-valid", "path.twin_id"),
    (
        "GET",
        f"{TWIN}?at=yesterday",
        422,
        "not-valid",
        "query.at, yesterday is not a valid date and time",
    ),
    ("GET", f"{TWIN}/history?start=slow:x", 422, "not-valid", "query.start"),
    ("GET", f"{TWIN}/history?max_points=1", 422, "not-valid", "greater than or equal to 2"),
    ("GET", f"{TWIN}/history?max_points=many", 422, "not-valid", "'many' was given"),
    ("GET", f"{TWIN}/forecast?horizon=-1", 422, "not-valid", "query.horizon"),
    ("GET", f"{TWIN}/forecast?horizon=nan", 422, "not-valid", "query.horizon"),
    ("GET", f"{TWIN}/forecast?threshold=-2", 422, "not-valid", "query.threshold"),
    ("GET", f"{TWIN}/forecast?quantity=mass_change", 422, "not-valid", "without a threshold"),
    (
        "GET",
        f"{TWIN}/forecast?threshold=0.1&quantity=mass_change",
        422,
        "not-valid",
        "Allowed: stiffness_change",
    ),
    ("GET", f"{TWIN}/events?after=-1", 422, "not-valid", "query.after"),
]


@pytest.mark.parametrize(("method", "path", "status", "slug", "says"), PROBLEMS)
def test_every_error_is_a_problem_document(server, method, path, status, slug, says):
    answer = server.client.request(method, path)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["type"] == f"urn:slowtime:problem:{slug}"
    assert body["status"] == status
    assert body["title"]
    assert says in body["detail"]
    assert body["instance"].startswith("/")


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b"{", "This is not JSON: Expecting property name"),
        (b"[]", "object"),
        (b'{"changes": "colour"}', "body.changes, 'colour' was given"),
        (b'{"chages": "mass"}', "body.chages, 'mass' was given"),
        (b'{"nominal": {"frequency_hz": -3}}', "body.nominal.frequency_hz"),
        (b'{"nominal": {"frequency_hz": NaN}}', "body"),
        (b'{"nominal": {"mass_kg": 3}}', "given twice, or not whole"),
    ],
)
def test_a_wrong_registration_is_refused_with_where_and_why(server, body, says):
    answer = server.client.put(TWIN, content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert says in str(answer.json())
    assert server.get(TWIN).json()["registration"]["name"] == "Beam"


def test_a_body_too_large_is_refused_whatever_its_header_says(server):
    answer = server.client.post(f"{TWIN}/simulate", content=b" " * 10**6)
    assert answer.status_code == 413
    assert "1000000 bytes was given. Allowed: up to 65,536" in answer.json()["detail"]
    answer = server.client.put(TWIN, content=iter([b" " * 10**6] * 5))
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    assert server.get("/healthz").status_code == 200


def test_every_route_is_described_with_an_example(server):
    document = server.get("/api/v1/openapi.json").json()
    assert set(document["paths"]) == {
        "/api/v1/twins", "/api/v1/twins/{twin_id}", "/api/v1/twins/{twin_id}/history",
        "/api/v1/twins/{twin_id}/history/hash", "/api/v1/twins/{twin_id}/forecast",
        "/api/v1/twins/{twin_id}/events", "/api/v1/twins/{twin_id}/live",
        "/api/v1/twins/{twin_id}/modes", "/api/v1/twins/{twin_id}/shapes",
            "/api/v1/twins/{twin_id}/gap",
        "/api/v1/twins/{twin_id}/diagnoses", "/api/v1/twins/{twin_id}/diagnoses/{number}",
        "/api/v1/twins/{twin_id}/diagnoses/{number}/{name}",
        "/api/v1/twins/{twin_id}/diagnoses/{number}/adopt",
        "/api/v1/twins/{twin_id}/diagnoses/{number}/undo", "/healthz", "/readyz", "/metrics",
        "/api/v1/session", "/api/v1/twins/{twin_id}/simulate", "/api/v1/asyncapi.json",
        "/api/v1/twins/{twin_id}/history/export", "/api/v1/twins/{twin_id}/dtdl",
        "/api/v1/dtdl", "/api/v1/recordings", "/api/v1/recordings/{name}",
        "/api/v1/recordings/{name}/replay", "/api/v1/twins/{twin_id}/alarms",
        "/api/v1/twins/{twin_id}/alarms/deliveries", "/api/v1/twins/{twin_id}/alarms/test",
        "/api/v1/twins/{twin_id}/alarms/{event_id}/acknowledge", "/api/v1/ledger/heads",
        "/api/v1/composites", "/api/v1/composites/{composite_id}",
        "/api/v1/composites/{composite_id}/members",
        "/api/v1/composites/{composite_id}/revisions", "/api/v1/twins/{twin_id}/memberships",
        "/api/v1/twins/{twin_id}/events/recorded", "/api/v1/twins/{twin_id}/fatigue",
        "/api/v1/twins/{twin_id}/virtual", "/api/v1/twins/{twin_id}/risk",
        "/api/v1/twins/{twin_id}/plan", "/api/v1/fleet/plan",
        "/api/v1/twins/{twin_id}/quarantine", "/api/v1/twins/{twin_id}/quarantine/{number}",
        "/api/v1/twins/{twin_id}/quarantine/{number}/release",
        "/api/v1/twins/{twin_id}/ledger", "/api/v1/ledger/chains/{chain}/consistency",
        "/api/v1/ledger/chains/{chain}/inclusion",
        "/api/v1/holdings",
        "/api/v1/holdings/{holding_id}",
        "/api/v1/composites/{composite_id}/events",
        "/api/v1/twins/{twin_id}/changes", "/api/v1/twins/{twin_id}/forecast/record",
    }  # fmt: skip
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            assert operation["description"], (method, path)
    for name in (
        "State", "TwinModel", "Registration", "ModesModel", "DiagnosisOrder", "DiagnosisModel",
        "GapModel", "ForecastModel", "CrossingModel", "SimulationOrder", "SimulationModel",
        "HeadList", "AssetEventOrder", "RiskModel", "PlanModel", "Composite", "CompositeModel",
        "FatigueModel", "VirtualModel", "AsideModel", "TwinChangeOrder",
    ):  # fmt: skip
        assert document["components"]["schemas"][name]["examples"]


def test_the_document_says_which_token_a_route_wants_and_how_it_refuses(server):
    document = server.get("/api/v1/openapi.json").json()
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    operations = {
        (method.upper(), path): operation
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }
    free = {of for of, operation in operations.items() if "security" not in operation}
    # As in docs/access.md, which is what was seen at the door.
    assert free == {
        ("GET", "/healthz"), ("GET", "/readyz"), ("DELETE", "/api/v1/session"),
        ("GET", "/api/v1/asyncapi.json"),
    }  # fmt: skip
    deleting = operations["DELETE", "/api/v1/twins/{twin_id}"]
    assert "admin of the twin's site" in deleting["description"]
    assert {"204", "401", "403", "404", "429"} <= deleting["responses"].keys()


def test_the_page_comes_with_all_it_needs(server):
    page = server.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "//" not in page.text.replace("http://www.w3.org/2000/svg", "")
    script = re.search(r"/assets/(app-[0-9a-f]+.js)", page.text)
    assert script
    for name in (script[1], "style.css"):
        assert f"/assets/{name}" in page.text
        asset = server.get(f"/assets/{name}")
        assert asset.status_code == 200
        assert len(asset.content) > 1000


def test_registering_again_estimates_again_and_deleting_forgets(serving, ageing, eventually):
    own = serving()
    own.feed(ageing(60))
    assert eventually(lambda: own.count() == 60)
    learning = own.get(f"{TWIN}/history").json()["points"]
    assert learning[0]["stiffness_change"] is None
    body = {"changes": "mass", "nominal": {"frequency_hz": 3.0}}
    answer = own.client.put(TWIN, json=body)
    assert answer.status_code == 200
    TwinModel.model_validate(answer.json())
    again = own.get(f"{TWIN}/history").json()["points"]
    assert len(again) == 60
    assert again[0]["mass_change"] is not None
    assert again[0]["assumed"] == ["stiffness_change"]
    assert own.client.delete(TWIN).status_code == 204
    assert own.get("/api/v1/twins").json() == {"twins": []}


def test_a_twin_without_features_says_so(serving):
    own = serving()
    assert own.client.put(TWIN, json={}).status_code == 201
    twin = own.get(TWIN).json()
    TwinModel.model_validate(twin)
    assert twin["reasons"] == [
        "There are no features yet. Start the edge agent, or ask for a later one."
    ]
    assert own.get(f"{TWIN}/history").json() == {"points": []}
    forecast = own.get(f"{TWIN}/forecast").json()
    assert forecast["valid"] is False
    assert "too few valid readings" in forecast["reasons"][0]


def test_a_hostile_message_is_counted_in_metrics_and_stops_nothing(
    serving, ageing, features, sample, eventually
):
    own = serving()
    first, *rest = ageing(5)
    own.feed([first])
    key, good = sample(first).key, sample(first).payload
    for payload in (b"\xff", good.replace(b'"slow_time":0.0', b'"slow_time":NaN'),
                    good.replace(b'"version":3', b'"version":77'), bytes(2**21)):  # fmt: skip
        own.bus.publish(key, payload, encoding="application/json")
    future = features(9, time_base="live", t_ns=SystemClock().now_ns() + 10**15)
    own.bus.publish(key, sample(future).payload, encoding="application/json")
    own.feed([first, *rest])
    assert eventually(lambda: own.count() == 5)
    metrics = own.get("/metrics").text
    for reason in ("not_json", "not_finite", "unknown_version", "too_large", "future_clock",
                   "duplicate"):  # fmt: skip
        assert f'refused_total{{reason="{reason}"}} 1' in metrics


def test_not_ready_says_what_is_wrong(serving):
    own = serving()
    own.bus.connected = False
    answer = own.get("/readyz")
    assert answer.status_code == 503
    assert answer.json()["type"] == "urn:slowtime:problem:not-ready"
    assert "The router is not connected" in answer.json()["detail"]


def test_nonsense_on_the_socket_does_not_end_the_server(server):
    host, port = server.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), 60) as raw:
        raw.sendall(b"\x16\x03\x01 not http at all\r\n\r\n")
        assert raw.recv(100).startswith(b"HTTP/1.1 400")
    assert server.get("/healthz").status_code == 200


FRAME = "/api/v1/twins/lab.frame"


@pytest.fixture(scope="module")
def framed(serving, frame, eventually):
    """A server with a frame whose second storey has been weaker since its 40th epoch."""
    started, made = serving(), frame(seed=1)
    body = made.registration(alarms=[{"quantity": "storey2", "below": -0.05}])
    assert started.client.put(FRAME, json=body).status_code == 201
    started.feed([made.epoch(i, (0.0, -0.08 * (i >= 40), 0.0)) for i in range(60)])
    assert eventually(lambda: started.count("lab.frame") == 60)
    return started


@pytest.mark.long
def test_a_twin_of_elements_tells_what_changed_and_its_modes(framed):
    twin = framed.get(FRAME).json()
    known = TwinModel.model_validate(twin)
    assert known.suspects == ("storey2",)
    assert known.elements["storey2"].hi < -0.05
    assert known.posterior_to_prior["storey2"] < 0.1
    assert (known.stiffness_change, known.mass_change) == (None, None)
    assert twin["truth"] == {"storey1": 0.0, "storey2": -0.08, "storey3": 0.0}
    assert [len(mode.shape.re) for mode in known.modes if mode.shape] == [3, 3, 3]
    (listed,) = framed.get("/api/v1/twins").json()["twins"]
    assert listed["elements"] == twin["elements"]
    assert {mode["shape"] for mode in listed["modes"]} == {None}


@pytest.mark.long
def test_modes_come_with_shapes_and_with_what_was_learnt(framed, server):
    found = ModesModel.model_validate(framed.get(f"{FRAME}/modes").json())
    assert [mode.model_mode for mode in found.modes] == [0, 1, 2]
    assert found.channels == ("a_floor1", "a_floor2", "a_floor3")
    moved = [
        mode.frequency_hz.value / learnt.frequency_hz
        for mode, learnt in zip(found.modes, found.nominal, strict=True)
    ]
    assert all(0.95 < ratio < 1.003 for ratio in moved)
    assert min(moved) < 0.985
    first = ModesModel.model_validate(framed.get(f"{FRAME}/modes", at="slow:0").json())
    assert first.slow_time == 0.0
    (one,) = ModesModel.model_validate(server.get(f"{TWIN}/modes").json()).modes
    assert one.shape is None
    assert one.frequency_hz.value == server.get(TWIN).json()["frequency_hz"]["value"]
    none = framed.get(f"{FRAME}/modes", at="slow:-1").json()
    assert none["modes"] == []
    assert "no features at that moment" in none["reasons"][0]


@pytest.mark.long
@pytest.mark.parametrize("shapes", [False, True])
def test_the_history_of_elements_has_shapes_where_they_are_asked_for(framed, shapes):
    found = framed.get(f"{FRAME}/history", shapes=shapes).json()
    points = HistoryModel.model_validate(found).points
    assert [bool(point.elements) for point in points] == [False] * 20 + [True] * 40
    shaped = {mode.shape is not None for point in points for mode in point.modes}
    assert shaped == {shapes}


def test_fewer_points_hide_no_extreme_of_an_element(framed):
    every = framed.get(f"{FRAME}/history").json()["points"][20:]
    some = framed.get(f"{FRAME}/history", max_points=40).json()["points"]
    assert len(some) <= 40
    values = [point["elements"]["storey2"]["value"] for point in every]
    kept = [p["elements"]["storey2"]["value"] for p in some if p["elements"]]
    assert (min(kept), max(kept)) == (min(values), max(values))


def test_what_changed_is_told_once_and_by_name(framed):
    events = framed.get(f"{FRAME}/events").json()["events"]
    # Sudden changes are looked for beside the readings, and told when they are found.
    others = {"registered", "model_changed"}
    told = [(e["kind"], e["slow_time"]) for e in events if e["kind"] not in others]
    assert told == [("nominal_learnt", 19.0), ("element_changed", 42.0), ("alarm", 42.0)]
    by_kind = {event["kind"]: event for event in events}
    assert by_kind["element_changed"]["message"].startswith("storey2 has lost ")
    assert by_kind["alarm"]["message"].startswith(
        "Change of storey2 below −5 % with 97.5 % certainty"
    )


@pytest.mark.long
def test_each_element_is_forecast(framed):
    asked = framed.get(f"{FRAME}/forecast", horizon=10, points=5).json()
    forecast = ForecastModel.model_validate(asked)
    assert forecast.since == 59.0
    assert [point.slow_time for point in forecast.points] == [61.0, 63.0, 65.0, 67.0, 69.0]
    for point in forecast.points:
        assert list(point.elements) == ["storey1", "storey2", "storey3"]
        assert (point.stiffness_change, point.mass_change) == (None, None)
        assert point.elements["storey2"].hi < 0.0
    assert forecast.points[0].elements["storey2"].lo < -0.05
    again = framed.get(f"{FRAME}/forecast", horizon=10, points=5).json()
    assert again == asked


@pytest.mark.long
def test_what_is_normal_is_told_and_what_has_entered(serving, features, eventually):
    server, rng = serving(), np.random.default_rng(1)
    weather = {"names": ["temperature_c"], "train_epochs": 60}
    server.client.put(TWIN, json={"covariates": weather})
    made = []
    for i in range(80):
        warm = 10.0 * np.sin(i / 5.0)
        lost = 0.97 if i >= 70 else 1.0
        frequency = 3.0 * lost * np.exp(-0.004 * warm + 0.001 * rng.standard_normal())
        message = features(i, frequency_hz=float(frequency), sd=0.003)
        made.append(message.model_copy(update={"covariates": {"temperature_c": warm}}))
    server.feed(made[:60])
    assert eventually(lambda: server.count() == 60)
    before = TwinModel.model_validate(server.get(TWIN).json())
    assert any("still being learnt" in reason for reason in before.reasons)
    server.feed(made[60:])
    assert eventually(lambda: server.count() == 80)
    twin = TwinModel.model_validate(server.get(TWIN).json())
    (normal,) = twin.normal
    assert normal.law == "linear"
    assert normal.entered is not None
    assert normal.entered.stiffness_change is not None
    assert normal.entered.stiffness_change.lo < 0.97**2 - 1 < normal.entered.stiffness_change.hi
    assert normal.entered.since == pytest.approx(70.0, abs=2.0)
    assert twin.stiffness_change is not None
    assert twin.stiffness_change.lo < 0.97**2 - 1 < twin.stiffness_change.hi
    told = [e["kind"] for e in server.get(f"{TWIN}/events").json()["events"]]
    assert told == ["registered", "normal_learnt", "change_entered"]


@pytest.mark.parametrize(
    ("strange", "named"),
    [
        ("\u202e", "U+202E RIGHT-TO-LEFT OVERRIDE, a bidirectional control"),
        ("\u2066", "U+2066 LEFT-TO-RIGHT ISOLATE, a bidirectional control"),
        ("\x1b", "U+001B, a control character"),
        ("\x00", "U+0000, a control character"),
        ("\n", "U+000A, a control character"),
        ("\u200b", "U+200B ZERO WIDTH SPACE, an invisible formatting character"),
        ("\u2028", "U+2028 LINE SEPARATOR, a line separator"),
    ],
)
def test_a_name_that_does_not_look_like_what_it_is_is_refused(server, strange, named):
    name = f"To{strange}wer"
    spring = {"id": name, "between": ["base", "m"], "stiffness_n_per_m": 1.0}
    model = {"slowtime_model": 1, "nodes": [{"id": "m", "mass_kg": 1.0}], "elements": [spring]}
    for body in (
        {"name": name},
        {"covariates": {"names": [name]}},
        {"changes": "elements", "model": model},
        {"model": model | {"name": name, "elements": []}},
    ):
        refused = server.client.put("/api/v1/twins/lab.strange", json=body)
        assert refused.status_code == 422
        assert f"{named}, at position 3" in refused.json()["detail"]
    for path in (f"twins/lab.be{strange}am", f"recordings/a{strange}.mcap"):
        refused = server.client.put(f"/api/v1/{quote(path)}", json={})
        assert refused.status_code == 422
        assert named in refused.json()["detail"]
    assert "lab.strange" not in {t["id"] for t in server.get("/api/v1/twins").json()["twins"]}


def test_names_of_all_languages_are_names(server):
    for number, name in enumerate(("Türme & Brücken", "塔", "می\u200cشود", "ברג 4", "🌉")):
        path = f"/api/v1/twins/lab.named{number}"
        assert server.client.put(path, json={"name": name}).status_code == 201
        assert server.get(path).json()["registration"]["name"] == name
        assert server.client.delete(path).status_code == 204
