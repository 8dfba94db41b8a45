"""Events of assets through a pipeline: forecasts restart, replays agree, undoing undoes."""

import json
from typing import Any

import numpy as np
import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import CurveOfMessage, Fatigue, FatiguePoint
from slowtime_schemas.streams import ASSET_EVENT, FATIGUE
from slowtime_services.bus import MemoryBus, Sample
from twin_server.events.asset_events import QUESTION, TOLD, AssetEventOrder
from twin_server.persist import SqliteStore, StoreError
from twin_server.pipeline import (
    AssetEvents,
    ChangeHistory,
    ModelChangeMonitor,
    Pipeline,
    TwinKnowledge,
)
from twin_server.pipeline.analysis.forecast_cache import ForecastCache
from twin_server.registration.changes import Author
from twin_server.registration.twin import Registration
from twin_server.serve import Moment, ProblemError
from twin_server.settings import TwinSettings

TWIN = "lab.beam"
BEAM = Registration.model_validate(
    {
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
        "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
    }
)
AT = 59
REPAIR = {"event": "r1", "kind": "repair", "repair": {"restored_share": 1.0}, "person": "Ann"}


@pytest.fixture
def opened(tmp_path):
    """Open a pipeline over a store, as often as asked."""
    stores = []

    def start(name="twin", bus=None):
        store = SqliteStore(tmp_path / f"{name}.sqlite")
        stores.append(store)
        pipeline = Pipeline(TwinSettings(), store, bus=bus)
        pipeline.register(TWIN, BEAM)
        return pipeline, store, AssetEvents(pipeline, store)

    yield start
    for store in stores:
        store.close()


@pytest.fixture(scope="session")
def life(ageing):
    """Features of a beam that loses 20 % over 60 epochs, is repaired, and ages on."""
    return [*ageing(60), *ageing(60, first=60, seed=1)]


def record(asset_events, given, principal="ann"):
    return asset_events.record(TWIN, BEAM, AssetEventOrder.model_validate(given), principal)


def foreseen(prospects, twin=TWIN):
    """Bands of each quantity, by what is kept."""
    found = prospects.foresee(twin, 20.0, 5, ())
    assert found is not None
    return found.foresight.bands


def ahead(pipeline, store):
    """Bands of each quantity, by what a server that starts now would know."""
    return foreseen(ForecastCache(pipeline, store))


def test_the_forecast_restarts_at_once_from_a_repair(opened, life, sample):
    pipeline, store, asset_events = opened()
    prospects = ForecastCache(pipeline, store)
    pipeline.listen(prospects)
    pipeline.ingest(map(sample, life[:60]))
    before = foreseen(prospects)
    assert before["stiffness_change"][0, 0] == pytest.approx(-0.21, abs=0.02)
    told, new = record(asset_events, REPAIR)
    assert (new, told["slow_time"]) == (True, 59.0)
    after = foreseen(prospects)
    value, sd, low, high = after["stiffness_change"][0]
    assert value == pytest.approx(-0.013, abs=0.01)
    assert low < 0.0 < high
    assert 0.015 < sd < 0.05
    # Readings go on from there, and what they add is what a server that restarts finds.
    for one in life[60:90]:
        pipeline.ingest([sample(one)])
        if one.sequence % 10 == 9:
            kept = foreseen(prospects)
    again = ahead(pipeline, store)
    np.testing.assert_array_equal(kept["stiffness_change"], again["stiffness_change"])
    truth = -0.2 * (29 + 4) / 60
    assert kept["stiffness_change"][0, 2] < truth < kept["stiffness_change"][0, 3]


def then(knowledge, moment):
    """Bands as they would have been at a moment."""
    found = knowledge.outlook(TWIN, 10.0, 3, (), moment)
    assert found is not None
    return found.bands


def test_undoing_gives_back_the_forecast_of_before(opened, life, sample):
    pipeline, store, asset_events = opened()
    prospects = ForecastCache(pipeline, store)
    pipeline.listen(prospects)
    pipeline.ingest(map(sample, life[:60]))
    before = foreseen(prospects)["stiffness_change"]
    record(asset_events, REPAIR)
    between = foreseen(prospects)["stiffness_change"]
    record(asset_events, {"event": "u1", "kind": "note", "reverses": "r1"})
    after = foreseen(prospects)["stiffness_change"]
    np.testing.assert_array_equal(after, before)
    assert not np.array_equal(between, before)
    listed = asset_events.listed(TWIN)["events"]
    assert [(one["event"], one["reversed_by"]) for one in listed] == [
        ("u1", None),
        ("r1", "u1"),
    ]


def test_the_forecast_of_a_past_moment_knows_no_later_repair(opened, life, sample):
    pipeline, store, asset_events = opened()
    pipeline.ingest(map(sample, life[:80]))
    knowledge = TwinKnowledge(pipeline, store)
    moment = Moment(t_ns=life[55].t_ns)
    before = then(knowledge, moment)
    record(asset_events, REPAIR | {"slow_time": 59.5})
    after = then(knowledge, moment)
    np.testing.assert_array_equal(before["stiffness_change"], after["stiffness_change"])
    later = then(knowledge, Moment(t_ns=life[62].t_ns))
    assert later["stiffness_change"][0, 0] == pytest.approx(-0.015, abs=0.02)


def test_the_alarm_on_the_damaged_state_clears_after_the_repair(opened, life, sample):
    pipeline, store, asset_events = opened()
    pipeline.ingest(map(sample, life[:60]))
    record(asset_events, REPAIR)
    pipeline.ingest(map(sample, life[60:75]))
    kinds = [json.loads(row.body)["kind"] for row in store.events(TWIN, limit=100)]
    about = [kind for kind in kinds if kind in ("alarm", TOLD, "alarm_cleared")]
    assert about == ["alarm", TOLD, "alarm_cleared"]


def test_what_is_replayed_beside_features_that_are_not_stored_is_stored(
    opened, life, sample, monkeypatch
):
    pipeline, store, asset_events = opened("first")
    record(asset_events, REPAIR | {"slow_time": 3.0})
    (row,) = store.asset_events(TWIN)
    told = Sample(ASSET_EVENT.key("lab", "beam"), row.body.encode(), None, replayed=True)
    sums = Fatigue(
        site="lab", asset="beam", boot="b1", sequence=0, time_base="recorded",
        start_ns=life[0].t_ns, t_ns=life[9].t_ns,
        points=(
            FatiguePoint(
                name="k.stress", unit="MPa", bins=(60,), half_cycles=(100,), damage=1e-4,
                closed_damage=1e-4, ln_sd=0.5, slope=3.0,
                curve=CurveOfMessage(constant=1e12, slope=3.0), seconds=3_600.0,
            ),
        ),
    )  # fmt: skip
    fatigue = Sample(FATIGUE.key("lab", "beam"), encode(sums), None, replayed=True)
    pipeline, store, _ = opened("second")
    write = store.write

    def full(cut):
        if cut.features:
            raise StoreError("disk full")
        return write(cut)

    with monkeypatch.context() as faulty:
        faulty.setattr(store, "write", full)
        with pytest.raises(StoreError, match="disk full"):
            pipeline.ingest([*(sample(one, replayed=True) for one in life[:10]), fatigue, told])
    assert "disk full" in pipeline.failing
    assert store.count(TWIN) == 0
    assert [one.event for one in store.asset_events(TWIN)] == ["r1"]
    assert len(store.fatigue(TWIN)) == 1


def test_a_recording_with_events_replays_to_the_same_history_bit_for_bit(opened, life, sample):
    pipeline, store, asset_events = opened("first")
    stream = [sample(one, replayed=True) for one in life[:100]]
    pipeline.ingest(stream[:60])
    record(asset_events, REPAIR | {"text": "Bolts.", "conditions": {"temperature_c": 11.5}})
    pipeline.ingest(stream[60:80])
    scan = {"detected": False, "probability_of_detection": {"a50": 0.1, "slope": 2.0}}
    record(asset_events, {"event": "i1", "kind": "inspection", "detection": scan})
    pipeline.ingest(stream[80:])
    record(asset_events, {"event": "u1", "kind": "note", "reverses": "i1"})
    text = {"text": "Bolts of the base."}
    asset_events.correct(TWIN, BEAM, "r1", text, Author("bob", "Bob", "Which bolts."))
    key = ASSET_EVENT.key("lab", "beam")
    bodies = [row.body.encode() for row in store.asset_events(TWIN)]

    again, other, _ = opened("second")
    replayed = [Sample(key, body, None, True) for body in bodies]
    # As in a recording, each between the features that it came between; then all once more.
    again.ingest([*stream[:60], replayed[0], *stream[60:80], replayed[1], *stream[80:]])
    again.ingest([*replayed[2:], *replayed])
    assert other.digest(TWIN) == store.digest(TWIN)
    assert [row.body for row in other.asset_events(TWIN)] == [
        row.body for row in store.asset_events(TWIN)
    ]
    (change,) = ChangeHistory(again, other, AssetEvents(again, other)).listed(TWIN)["changes"]
    assert (change["event"], change["text"], change["person"]) == ("r1", "Which bolts.", "Bob")
    assert change["changes"] == [{"field": "text", "before": "Bolts.", "after": text["text"]}]
    np.testing.assert_array_equal(
        ahead(pipeline, store)["stiffness_change"],
        ahead(again, other)["stiffness_change"],
    )
    # What is live is the server's own, and comes by REST.
    third, empty, _ = opened("third")
    third.ingest([*stream[:5], Sample(key, bodies[0], None, False)])
    assert empty.asset_events(TWIN) == []


def test_an_accepted_event_is_said_on_the_bus(opened):
    bus, heard = MemoryBus(), list[Sample]()
    bus.subscribe(ASSET_EVENT.everywhere, heard.append)
    _, store, asset_events = opened(bus=bus)
    record(asset_events, REPAIR)
    record(asset_events, REPAIR)
    assert [one.payload.decode() for one in heard] == [
        row.body for row in store.asset_events(TWIN)
    ]


def test_the_same_twice_is_one_event_and_another_under_its_id_is_refused(opened, life, sample):
    pipeline, store, asset_events = opened()
    pipeline.ingest(map(sample, life[:60]))
    first, new = record(asset_events, REPAIR)
    pipeline.ingest(map(sample, life[60:70]))
    assert record(asset_events, REPAIR) == (first, False)
    assert record(asset_events, REPAIR | {"slow_time": None}) == (first, False)
    for other in ({"text": "x"}, {"person": "Bob"}, {"slow_time": 3.0}, {"repair": None}):
        with pytest.raises(ProblemError, match="with other content: Repair recorded by Ann"):
            record(asset_events, REPAIR | other)
    assert len(store.asset_events(TWIN)) == 1
    assert new


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"quantity": "j2"}, "j2 was given. Allowed for lab.beam: stiffness_change"),
        ({"slow_time": 60.5}, r"60.5 was given. Allowed: up to 59"),
        ({"at": 2**62}, "in the future"),
    ],
)
def test_what_does_not_fit_is_refused(opened, life, sample, given, match):
    pipeline, _, asset_events = opened()
    pipeline.ingest(map(sample, life[:60]))
    with pytest.raises(ProblemError, match=match):
        record(asset_events, REPAIR | given)


@pytest.mark.parametrize(
    ("name", "match"), [("r9", "r9 was given. Events that can be undone"), ("u1", "u1 was")]
)
def test_only_what_holds_is_taken_back(opened, life, sample, name, match):
    pipeline, _, asset_events = opened()
    pipeline.ingest(map(sample, life[:10]))
    record(asset_events, REPAIR)
    record(asset_events, {"event": "u1", "kind": "note", "reverses": "r1"})
    with pytest.raises(ProblemError, match=match):
        record(asset_events, {"event": "u2", "kind": "note", "reverses": name})
    with pytest.raises(ProblemError, match="r1 was taken back by u1 already"):
        record(asset_events, {"event": "u2", "kind": "note", "reverses": "r1"})


@pytest.fixture
def watched(opened, life, sample, eventually):
    """Feed a life, with or without the repair told, to a pipeline whose twins are watched."""

    def run(*, told, upto=66):
        pipeline, store, asset_events = opened()
        monitor = ModelChangeMonitor(pipeline, store)
        pipeline.listen(monitor)
        monitor.start()
        try:
            pipeline.ingest(map(sample, life[:60]))
            if told:
                record(asset_events, REPAIR)
            for one in life[60:upto]:
                pipeline.ingest([sample(one)])
            assert eventually(lambda: monitor._seen.get(TWIN) == float(upto - 1))
            assert eventually(lambda: not monitor._news)
            monitor.stop()
            events = [json.loads(row.body) for row in store.events(TWIN, limit=1000)]
        finally:
            monitor.stop()
        return pipeline, asset_events, events

    return run


def test_a_repair_that_nobody_told_is_asked_about_within_five_epochs(watched):
    _, asset_events, events = watched(told=False, upto=65)
    (asked,) = [event for event in events if event["kind"] == QUESTION]
    assert asked["severity"] == "warning"
    assert asked["details"]["since"] == AT
    assert asked["details"]["size"] == pytest.approx(0.2, abs=0.03)
    assert asked["details"]["noticed"] <= AT + 5
    assert "Was something repaired? stiffness_change went from -1" in asked["message"]
    (question,) = asset_events.listed(TWIN)["questions"]
    assert question["answered_by"] is None
    record(asset_events, REPAIR | {"slow_time": 58.0})
    assert asset_events.listed(TWIN)["questions"][0]["answered_by"] == "r1"
    record(asset_events, {"event": "u1", "kind": "note", "reverses": "r1"})
    assert asset_events.listed(TWIN)["questions"][0]["answered_by"] is None
    record(
        asset_events,
        {"event": "n1", "kind": "note", "answers": question["event_id"], "text": "Frost."},
    )
    assert asset_events.listed(TWIN)["questions"][0]["answered_by"] == "n1"


def test_a_told_repair_is_no_sudden_change_and_asks_nothing(watched):
    _, asset_events, events = watched(told=True, upto=90)
    assert {event["kind"] for event in events} & {QUESTION, "model_changed"} == set()
    assert asset_events.listed(TWIN)["questions"] == []


@pytest.mark.long
def test_a_repair_of_one_element_leaves_the_others_as_they_were(opened, frame, sample):
    edge = frame()
    pipeline, store, asset_events = opened()
    twin = "lab.frame"
    registration = Registration.model_validate(edge.registration(learn_epochs=5))
    pipeline.register(twin, registration)
    losses = [(0.0, -0.006 * max(n - 5, 0), -0.003 * max(n - 5, 0)) for n in range(36)]
    pipeline.ingest(sample(edge.epoch(n, changes)) for n, changes in enumerate(losses))
    prospects = ForecastCache(pipeline, store)
    pipeline.listen(prospects)
    before = foreseen(prospects, twin)
    for name, kind in (("storey9", "repair"), (None, "inspection")):
        given: dict[str, Any] = {"event": "x", "kind": kind, "quantity": name}
        if kind == "inspection":
            given["measured"] = {"value": -0.1, "sd": 0.01}
        order = AssetEventOrder.model_validate(given)
        with pytest.raises(ProblemError, match="storey1, storey2, storey3"):
            asset_events.record(twin, registration, order, "ann")
    order = AssetEventOrder.model_validate(REPAIR | {"quantity": "storey2"})
    asset_events.record(twin, registration, order, "ann")
    after = foreseen(prospects, twin)
    np.testing.assert_array_equal(after["storey3"], before["storey3"])
    assert before["storey2"][0, 0] == pytest.approx(-0.19, abs=0.04)
    assert after["storey2"][0, 0] == pytest.approx(-0.01, abs=0.03)


def test_a_route_takes_questions_to_those_who_are_to_answer(opened, life, sample, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("a secret that is long enough")
    store = SqliteStore(tmp_path / "routed.sqlite")
    hook = {"kind": "webhook", "url": "http://127.0.0.1:1/", "secret_file": secret}
    settings = TwinSettings(alarms={"receivers": {"ops": hook, "boss": hook}})
    pipeline = Pipeline(settings, store, bus=MemoryBus())
    routes = [
        {"receiver": "ops", "severities": ["warning"], "kinds": [QUESTION]},
        {"receiver": "boss"},
    ]
    pipeline.register(TWIN, BEAM.model_copy(update={"alarm_routes": ()}))
    pipeline.register(
        TWIN, Registration.model_validate(BEAM.to_dict() | {"alarm_routes": routes})
    )
    pipeline.routing._live["lab", "beam"] = True
    pipeline.note(TWIN, QUESTION, "warning", "Was something repaired?", {"quantity": "x"})
    assert [(one.receiver, one.kind) for one in store.deliveries()] == [("ops", QUESTION)]
    store.close()
