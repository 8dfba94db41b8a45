"""The pipeline: whatever happens on the way, the history of an undisturbed run."""

import contextlib
import itertools
import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slowtime_schemas.codec import decode_sample, encode
from slowtime_schemas.messages import Health, TwinState
from slowtime_schemas.streams import (
    ACK,
    EVENT,
    HEALTH,
    REGISTRATION,
    STATE,
    current_key,
    former_key,
)
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.clock import HandClock
from twin_server import estimate as estimators
from twin_server.history.states import SET_ASIDE
from twin_server.persist import SqliteStore, StoreError, open_store
from twin_server.pipeline import Pipeline
from twin_server.pipeline.ingestion import estimation, failure_log
from twin_server.pipeline.ingestion.state_publisher import ACK_EVERY_S
from twin_server.pipeline.progress import isolation
from twin_server.registration.twin import Registration
from twin_server.settings import PipelineSettings, TwinSettings


@pytest.fixture
def open_twin(database, settings):
    """Start pipelines on databases, and end what is left of them."""
    running = []

    def start(bus=None, *, name="twin", with_settings=settings):
        store = open_store(database(name))
        pipeline = Pipeline(with_settings, store, bus=bus)
        pipeline.start()
        running.append((pipeline, store))
        return pipeline, store

    yield start
    for pipeline, store in running:
        pipeline.stop()
        store.close()


def undisturbed(tmp_path, messages, sample, registration=None):
    """The digest of a run in which nothing went wrong."""
    store = SqliteStore(tmp_path / f"undisturbed-{time.monotonic_ns()}.sqlite")
    pipeline = Pipeline(TwinSettings(), store)
    if registration is not None:
        pipeline.register("lab.beam", registration)
    pipeline.ingest(map(sample, messages))
    pipeline.give_up()
    digest = store.digest("lab.beam")
    store.close()
    return digest


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_order_doubles_and_cuts_give_the_same_history(
    tmp_path, ageing, sample, data, database
):
    messages = ageing(40) + ageing(15, boot="b2")
    expected = undisturbed(tmp_path, messages, sample)
    with contextlib.closing(open_store(database(f"x{time.monotonic_ns()}"))) as store:
        pipeline = Pipeline(TwinSettings(), store)
        places = [
            *data.draw(st.permutations(range(40))),
            *data.draw(st.permutations(range(40, 55))),
        ]
        places += data.draw(st.lists(st.integers(0, 54), max_size=10))
        arriving = [messages[place] for place in places]
        while arriving:
            some = data.draw(st.integers(1, len(arriving)))
            pipeline.ingest(map(sample, arriving[:some]))
            arriving = arriving[some:]
            if data.draw(st.booleans()):
                pipeline = Pipeline(TwinSettings(), store)  # as after a SIGKILL
        assert store.digest("lab.beam") == expected


def test_a_flood_with_losses_is_healed_over_the_bus(
    open_twin, edge, ageing, sample, tmp_path, eventually
):
    messages = ageing(300)
    with MemoryBus() as bus:
        _, store = open_twin(bus)
        beam = edge(MemoryBus(joins=bus))
        for message in messages:
            beam.make(message, send=message.sequence % 7 != 3)
        assert eventually(lambda: store.count("lab.beam") == 300)
        assert store.digest("lab.beam") == undisturbed(tmp_path, messages, sample)
        beam.close()


def test_a_server_that_starts_late_has_all_that_the_edge_still_holds(
    open_twin, edge, ageing, eventually
):
    with MemoryBus() as bus:
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(50):
            beam.make(message)
        beam.forget("b1", *range(10))
        _, store = open_twin(bus)
        assert eventually(lambda: store.count("lab.beam") == 40)
        (lost,) = [json.loads(e.body) for e in store.events() if "features_lost" in e.body]
        assert (lost["details"]["first"], lost["details"]["last"]) == (0, 9)
        assert lost["severity"] == "info"


def test_a_lost_tail_is_fetched_on_the_word_of_health(open_twin, edge, ageing, eventually):
    with MemoryBus() as bus:
        _, store = open_twin(bus)
        beam = edge(MemoryBus(joins=bus))
        *most, last = ageing(10)
        for message in most:
            beam.make(message)
        assert eventually(lambda: store.count("lab.beam") == 9)
        beam.make(last, send=False)
        health = Health(
            site="lab", asset="beam", boot="b1", sequence=0, t_ns=1, last_sequence=9,
            first_held=0, uptime_s=1.0,
        )  # fmt: skip
        bus.publish(HEALTH.key("lab", "beam"), encode(health), encoding=HEALTH.encoding)
        assert eventually(lambda: store.count("lab.beam") == 10)


def test_only_what_is_durable_is_acknowledged(open_twin, edge, ageing, eventually, tmp_path):
    acknowledged: list[tuple[int, int]] = []
    with MemoryBus() as bus:
        _, store = open_twin(bus)

        def hear(sample):
            sequence = decode_sample(sample.key, sample.payload).sequence
            acknowledged.append((sequence, store.count("lab.beam")))

        bus.subscribe(ACK.everywhere, hear)
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(200):
            beam.make(message)
            time.sleep(0.0005)
        assert eventually(lambda: acknowledged and acknowledged[-1][0] == 199)
    assert all(count >= sequence + 1 for sequence, count in acknowledged)


def test_states_events_and_registrations_travel_as_the_messages_they_are(
    open_twin, edge, ageing, eventually
):
    heard: list[Sample] = []
    with MemoryBus() as bus:
        pipeline, store = open_twin(bus)
        for stream in (STATE, EVENT, REGISTRATION):
            bus.subscribe(stream.everywhere, heard.append)
        pipeline.register("lab.beam", Registration(nominal={"frequency_hz": 3.0}))
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(30):
            beam.make(message)
        states = lambda: [s for s in heard if s.key == STATE.key("lab", "beam")]  # noqa: E731
        assert eventually(lambda: len(states()) == 30)
    messages = [decode_sample(s.key, s.payload) for s in heard]
    told = [m for m in messages if isinstance(m, TwinState)]
    assert [m.sequence for m in told] == list(range(30))
    assert told[-1].truth is not None
    assert {m.MESSAGE for m in messages} == {"state", "registration"}
    assert not store.events()[0].derived


def test_a_recorded_registration_is_taken_and_a_live_one_is_an_echo(
    open_twin, ageing, sample, tmp_path
):
    kept: list[Sample] = []
    registration = Registration(nominal={"frequency_hz": 3.0, "damping_ratio": 0.02})
    with MemoryBus() as bus:
        bus.subscribe(REGISTRATION.everywhere, kept.append)
        pipeline, _ = open_twin(bus)
        pipeline.register("lab.beam", registration)
    messages = ageing(40)
    pipeline, store = open_twin(name="fresh.sqlite")
    pipeline.ingest([sample(messages[0]), kept[0], *map(sample, messages[1:])])
    assert pipeline.twin("lab.beam").registration == Registration()
    pipeline.ingest([kept[0]._replace(replayed=True)])
    assert pipeline.twin("lab.beam").registration == registration
    assert store.digest("lab.beam") == undisturbed(tmp_path, messages, sample, registration)


@pytest.mark.parametrize("later", [{"nominal": {"frequency_hz": 3.0}}, {"changes": "mass"}])
def test_registering_anew_gives_the_history_of_having_known_before(
    open_twin, ageing, sample, tmp_path, heard, later, monkeypatch
):
    monkeypatch.setattr(estimation, "REESTIMATE_BATCH", 7)
    messages = ageing(60, loss=0.5) + ageing(10, boot="b2")
    pipeline, store = open_twin()
    pipeline.listen(heard)
    pipeline.ingest(map(sample, messages))
    assert pipeline.register("lab.beam", Registration(**later)) is False
    assert heard.resets == ["lab.beam"]
    expected = undisturbed(tmp_path, messages, sample, Registration(**later))
    assert store.digest("lab.beam") == expected
    pipeline.ingest([sample(m) for m in ageing(20, boot="b2")[10:]])
    assert store.count("lab.beam") == 80
    kinds = [json.loads(e.body)["kind"] for e in store.events()]
    assert kinds.count("registered") == 2
    assert kinds.count("nominal_learnt") == (0 if "nominal" in later else 1)


@pytest.mark.long
def test_a_twin_in_the_weather_has_one_history_however_it_came_by_it(
    features, sample, tmp_path, database
):
    rng, messages = np.random.default_rng(3), []
    for i in range(70):
        warm = 10.0 * np.sin(i / 4.0)
        lost = 0.97 if i >= 55 else 1.0
        frequency = 3.0 * lost * np.exp(-0.004 * warm + 0.001 * rng.standard_normal())
        message = features(i, frequency_hz=float(frequency), sd=0.003)
        messages.append(message.model_copy(update={"covariates": {"temperature_c": warm}}))
    weather = {"names": ["temperature_c"], "train_epochs": 40}
    registration = Registration(covariates=weather)
    expected = undisturbed(tmp_path, messages, sample, registration)
    with contextlib.closing(open_store(database("killed"))) as store:
        Pipeline(TwinSettings(), store).register("lab.beam", registration)
        for first, last in itertools.pairwise((0, 13, 39, 40, 56, 70)):
            killed = Pipeline(TwinSettings(), store)  # each begins from what is durable
            killed.ingest(map(sample, messages[first:last]))
        assert store.digest("lab.beam") == expected
        kinds = [json.loads(e.body)["kind"] for e in store.events("lab.beam")]
        assert kinds == ["registered", "normal_learnt", "change_entered"]
    with contextlib.closing(open_store(database("anew"))) as store:
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.ingest(map(sample, messages))
        pipeline.register("lab.beam", registration)
        assert store.digest("lab.beam") == expected


def test_registering_the_same_again_changes_nothing(open_twin, heard):
    pipeline, store = open_twin()
    assert pipeline.register("lab.beam", Registration()) is True
    pipeline.listen(heard)
    assert pipeline.register("lab.beam", Registration()) is False
    assert not heard.resets
    assert len(store.events()) == 1


def test_a_deleted_twin_is_born_again_by_its_edge(open_twin, edge, ageing, eventually):
    with MemoryBus() as bus:
        pipeline, store = open_twin(bus)
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(10):
            beam.make(message)
        assert eventually(lambda: store.count("lab.beam") == 10)
        assert pipeline.delete("lab.beam")
        assert not pipeline.delete("lab.nobody")
        assert eventually(lambda: store.count("lab.beam") == 10)


def test_listeners_hear_each_state_once_in_order(open_twin, ageing, sample, heard):
    pipeline, _ = open_twin()
    pipeline.listen(heard)
    messages = ageing(50)
    for part in (messages[:20], messages[10:30], messages[30:]):
        pipeline.ingest(map(sample, part))
    sequences = [s for news in heard.news for s in news.states["sequence"].tolist()]
    assert sequences == list(range(50))
    kinds = [json.loads(body)["kind"] for news in heard.news for _, body in news.events]
    assert kinds == ["registered", "nominal_learnt"]


def test_a_disk_that_is_full_for_a_while_loses_nothing(
    open_twin, edge, ageing, sample, tmp_path, eventually, monkeypatch
):
    messages = ageing(60)
    with MemoryBus() as bus:
        pipeline, store = open_twin(bus)
        beam = edge(MemoryBus(joins=bus))
        for message in messages[:20]:
            beam.make(message)
        assert eventually(lambda: store.count("lab.beam") == 20)
        write = store.write
        monkeypatch.setattr(store, "write", _full)
        for message in messages[20:40]:
            beam.make(message)
        assert eventually(lambda: "disk full" in pipeline.failing)
        monkeypatch.setattr(store, "write", write)
        for message in messages[40:]:
            beam.make(message)
        assert eventually(lambda: store.count("lab.beam") == 60)
        assert eventually(lambda: not pipeline.failing)
        assert pipeline.counts["failed_batches"] > 0
        assert store.digest("lab.beam") == undisturbed(tmp_path, messages, sample)


def test_what_a_database_that_is_away_did_not_take_is_not_acknowledged(
    open_twin, edge, ageing, sample, tmp_path, eventually, monkeypatch
):
    monkeypatch.setattr(failure_log, "TOLD_S", 0.1)
    messages, acknowledged = ageing(60), []
    with MemoryBus() as bus:
        pipeline, store = open_twin(bus)
        bus.subscribe(ACK.everywhere, lambda s: acknowledged.append(json.loads(s.payload)))
        beam = edge(MemoryBus(joins=bus))
        for message in messages[:20]:
            beam.make(message)
        assert eventually(lambda: acknowledged and acknowledged[-1]["sequence"] == 19)
        with monkeypatch.context() as away:  # it can be neither written nor read
            away.setattr(store, "write", _full)
            away.setattr(store, "twins", lambda: _full(None))
            for message in messages[20:40]:
                beam.make(message)
            assert eventually(lambda: "disk full" in pipeline.failing)
            time.sleep(3 * ACK_EVERY_S)
            assert max(ack["sequence"] for ack in acknowledged) == 19
        for message in messages[40:]:
            beam.make(message)
        assert eventually(lambda: acknowledged[-1]["sequence"] == 59)
        assert store.digest("lab.beam") == undisturbed(tmp_path, messages, sample)

        def told():
            events = [json.loads(row.body) for row in store.events("lab.beam")]
            return [event for event in events if event["kind"] == "database_away"]

        assert eventually(told)
        assert [event["severity"] for event in told()] == ["warning"]
        assert told()[0]["details"]["seconds"] > 0.1


@pytest.mark.parametrize("fails", ["write", "events"])
def test_silent_sensors_are_told_of_once_the_store_is_back(store, monkeypatch, fails):
    def silent(asset, sequence):
        health = Health(
            site="lab", asset=asset, boot="b1", sequence=sequence, t_ns=2 * 10**18,
            last_sequence=-1, first_held=-1, uptime_s=1.0, counters={"sensor_silent_s": 11},
        )  # fmt: skip
        return Sample(HEALTH.key("lab", asset), encode(health), None, replayed=False)

    assets = ("arch", "beam", "crane")
    pipeline = Pipeline(TwinSettings(), store)
    for asset in assets:
        pipeline.register(f"lab.{asset}", Registration())
    given = {"write": store.write, "events": store.events}[fails]

    def away(about, *more, **options):
        if "beam" in repr(getattr(about, "events", about)):
            raise StoreError("The database is away.")
        return given(about, *more, **options)

    with monkeypatch.context() as faulty:
        faulty.setattr(store, fails, away)
        with pytest.raises(StoreError, match="is away"):
            pipeline.ingest(silent(asset, 0) for asset in assets)
    pipeline.ingest(silent(asset, 1) for asset in assets)
    for asset in assets:
        kinds = [json.loads(row.body)["kind"] for row in store.events(f"lab.{asset}")]
        assert kinds.count("sensor_silent") == 1


def _full(cut):
    raise StoreError("disk full")


def test_features_that_make_the_server_fail_stop_no_others(
    open_twin, ageing, sample, monkeypatch, caplog
):
    def fragile(twins, features, *more):
        if any(f.asset == "bad" and f.sequence == 5 for f in features):
            raise ZeroDivisionError("a fault of ours")
        return estimators.estimate(twins, features, *more)

    monkeypatch.setattr(isolation, "estimate", fragile)
    pipeline, store = open_twin()
    mixed = [m for pair in zip(ageing(20), ageing(20, asset="bad"), strict=True) for m in pair]
    pipeline.ingest(map(sample, mixed))
    assert store.count("lab.beam") == 20
    assert store.count("lab.bad") == 20
    (row,) = store.aside("lab.bad")
    assert (row.sequence, row.accepted) == (5, True)
    assert "a fault of ours" in row.why
    assert "a fault of ours" in caplog.text
    reasons = store.history("lab.bad").states["reasons"]
    assert [place for place, bits in enumerate(reasons) if bits & SET_ASIDE] == [5]


def test_what_finds_no_room_is_counted_and_healed(edge, ageing, eventually, tmp_path, settings):
    small = settings.model_copy(
        update={"pipeline": settings.pipeline.model_copy(update={"inbox_messages": 10})}
    )
    store = SqliteStore(tmp_path / "x.sqlite")
    with MemoryBus() as bus:
        pipeline = Pipeline(small, store, bus=bus)
        blocked = threading.Event()
        pipeline.start()
        holding = threading.Thread(target=pipeline.call, args=(lambda: blocked.wait(60),))
        holding.start()
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(100):
            beam.make(message)
        assert pipeline.refusals.counts["inbox_full"] > 50
        blocked.set()
        holding.join()
        assert eventually(lambda: store.count("lab.beam") == 100)
        pipeline.stop()
    store.close()


def test_calls_to_a_busy_pipeline_are_not_counted_as_lost_messages(
    open_twin, features, sample, settings, eventually
):
    small = settings.model_copy(update={"pipeline": PipelineSettings(inbox_messages=10)})
    bus, blocked = MemoryBus(), threading.Event()
    pipeline, store = open_twin(bus, with_settings=small)
    with ThreadPoolExecutor(2) as pool:
        pool.submit(pipeline.call, lambda: blocked.wait(60))
        assert eventually(lambda: not pipeline._calls)
        for number in range(12):
            message = sample(features(number))
            bus.publish(message.key, message.payload, encoding="application/json")
        asked = pool.submit(pipeline.call, lambda: 5)
        assert eventually(lambda: len(pipeline._calls))
        blocked.set()
        assert asked.result(60) == 5
    assert eventually(lambda: store.count("lab.beam") == 10)
    assert pipeline.refusals.counts["inbox_full"] == 2
    assert pipeline.tallies()["inbox_dropped"] == 2


def test_a_call_while_the_worker_ends_is_answered(open_twin, eventually):
    ending, released, answers = threading.Event(), threading.Event(), []

    class Signing:
        def step(self):
            pass

        def take_unsaid(self):
            return {}

        def close(self):
            ending.set()
            released.wait(60)

    pipeline, _ = open_twin()
    pipeline.ledger_signer = Signing()
    stopping = threading.Thread(target=pipeline.stop)
    stopping.start()
    assert ending.wait(60)
    asking = threading.Thread(
        target=lambda: answers.append(pipeline.call(lambda: 5)), daemon=True
    )
    asking.start()
    assert eventually(lambda: answers == [5], timeout_s=10.0)
    released.set()
    stopping.join()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_call_that_waits_is_answered_where_the_worker_dies(
    open_twin, monkeypatch, eventually
):
    pipeline, answers, dying = open_twin()[0], [], threading.Event()

    def die(*_given, **_options):
        dying.set()
        eventually(lambda: pipeline._calls)
        raise MemoryError

    monkeypatch.setattr(pipeline._inbox, "take", die)
    assert dying.wait(60)
    asking = threading.Thread(
        target=lambda: answers.append(pipeline.call(lambda: 5)), daemon=True
    )
    asking.start()
    assert eventually(lambda: answers == [5], timeout_s=10.0)
    assert eventually(lambda: not pipeline.working)


def test_an_asset_nobody_registered_is_refused_where_settings_say_so(
    open_twin, ageing, sample, settings
):
    strict = settings.model_copy(update={"auto_register": False})
    pipeline, store = open_twin(with_settings=strict)
    pipeline.register("lab.beam", Registration())
    pipeline.ingest(map(sample, ageing(5) + ageing(5, asset="other")))
    assert [twin.id for twin in store.twins()] == ["lab.beam"]
    assert pipeline.refusals.counts["not_registered"] == 5


def test_stopping_finishes_what_has_arrived(tmp_path, settings, edge, ageing):
    store = SqliteStore(tmp_path / "x.sqlite")
    with MemoryBus() as bus:
        pipeline = Pipeline(settings, store, bus=bus)
        pipeline.start()
        beam = edge(MemoryBus(joins=bus))
        first, *rest = ageing(300)
        beam.make(first)
        while not store.count("lab.beam"):
            time.sleep(0.01)
        for message in rest:
            beam.make(message)
        pipeline.stop()
    assert store.count("lab.beam") == 300
    assert not pipeline.working
    store.close()


def test_a_clock_moved_by_hand_judges_messages(tmp_path, features, sample):
    now = 1_800_000_000 * 10**9
    store = SqliteStore(tmp_path / "x.sqlite")
    pipeline = Pipeline(TwinSettings(), store, clock=HandClock(now))
    pipeline.ingest(
        [
            sample(features(0, time_base="live", t_ns=now)),
            sample(features(1, time_base="live", t_ns=now + 10**12)),
        ]
    )
    assert store.count("lab.beam") == 1
    assert pipeline.refusals.counts["future_clock"] == 1
    store.close()


def test_a_server_that_falls_behind_does_not_blame_the_clocks_of_edges(
    tmp_path, settings, edge, ageing, eventually
):
    clock = HandClock(time.time_ns())
    is_busy, go_on = threading.Event(), threading.Event()

    def be_busy():
        is_busy.set()
        go_on.wait()

    store = SqliteStore(tmp_path / "x.sqlite")
    with MemoryBus() as bus:
        pipeline = Pipeline(settings, store, bus=bus, clock=clock)
        pipeline.start()
        busy = threading.Thread(target=pipeline.call, args=[be_busy])
        busy.start()
        assert is_busy.wait(60.0)
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(5):
            beam.make(message)
        assert eventually(lambda: pipeline.waiting >= 5)
        clock.sleep(400.0)
        go_on.set()
        busy.join()
        assert eventually(lambda: store.count("lab.beam") == 5)
        pipeline.stop()
    assert pipeline.refusals.counts["stale_clock"] == 0
    store.close()


def test_what_many_edges_answer_at_once_waits_for_the_disk_together(
    database, settings, ageing, edge, eventually, monkeypatch
):
    (message,) = ageing(1)
    names = [f"a{number}" for number in range(60)]
    with contextlib.closing(open_store(database())) as store, MemoryBus() as bus:
        edges = [edge(MemoryBus(joins=bus), asset=name) for name in names]
        for one in edges:
            one.conceal()  # each is asked once, when its first features have come
        pipeline = Pipeline(settings, store, bus=bus)
        pipeline.start()
        write, written = store.write, []

        def slowly(cut):
            # The disk is slower than all edges together.
            assert not cut.features or eventually(
                lambda: pipeline.tallies()["asked"] >= len(names)
            )
            written.append(cut)
            return write(cut)

        monkeypatch.setattr(store, "write", slowly)
        is_busy, all_sent = threading.Event(), threading.Event()

        def wait_for_all():
            is_busy.set()
            all_sent.wait()

        busy = threading.Thread(target=pipeline.call, args=(wait_for_all,))
        busy.start()
        is_busy.wait()  # else it may begin with the first message alone
        for name, one in zip(names, edges, strict=True):
            one.make(message.model_copy(update={"asset": name}))
        all_sent.set()
        busy.join()
        assert eventually(lambda: all(store.count(f"lab.{name}") == 1 for name in names))
        pipeline.stop()
        for one in edges:
            one.close()
    assert len(written) < 10


class FormerAgentBus(MemoryBus):
    """The bus of an edge agent that knows keys of the former version only."""

    def publish(self, key, payload, **more):
        super().publish(former_key(key) or key, payload, **more)

    def subscribe(self, key, callback):
        return super().subscribe(former_key(key) or key, callback)

    def announce(self, key):
        return super().announce(former_key(key) or key)

    def answer(self, key, handler):
        def spelt(query):
            asked = query._replace(key=current_key(query.key))
            return [(former_key(reply), payload) for reply, payload in handler(asked)]

        return super().answer(former_key(key) or key, spelt)


def test_an_agent_with_former_keys_is_healed_acknowledged_and_gives_the_same_history(
    open_twin, edge, ageing, sample, eventually, tmp_path
):
    messages = ageing(60)
    acknowledged = []
    with MemoryBus() as bus:
        pipeline, store = open_twin(bus)
        agents = FormerAgentBus(joins=bus)
        agents.subscribe(ACK.key("lab", "beam"), lambda one: acknowledged.append(one.payload))
        beam = edge(agents)
        assert eventually(lambda: pipeline.is_alive("lab.beam"))
        for message in messages:
            beam.make(message, send=message.sequence % 7 != 3)
        assert eventually(lambda: store.count("lab.beam") == 60)
        assert eventually(
            lambda: acknowledged and json.loads(acknowledged[-1])["sequence"] == 59
        )
    assert store.digest("lab.beam") == undisturbed(tmp_path, messages, sample)


def test_messages_that_follow_each_other_share_batches_and_a_lone_one_does_not_wait(
    open_twin, settings, features, sample, eventually
):
    bus = MemoryBus()
    gathering = settings.model_copy(update={"pipeline": PipelineSettings(gather_s=0.2)})
    pipeline, _ = open_twin(bus, with_settings=gathering)
    began_s = time.monotonic()
    for number in range(60):
        message = sample(features(number))
        bus.publish(message.key, message.payload, encoding="application/json")
        time.sleep(0.01)
    assert eventually(lambda: pipeline.counts["accepted"] == 60)
    took_s = time.monotonic() - began_s
    assert pipeline.counts["batches"] <= took_s / 0.2 + 1


@pytest.mark.parametrize("ends", [False, True])
def test_a_call_and_the_end_do_not_wait_for_messages_to_gather(
    open_twin, settings, features, sample, eventually, ends
):
    bus = MemoryBus()
    gathering = settings.model_copy(update={"pipeline": PipelineSettings(gather_s=10.0)})
    pipeline, store = open_twin(bus, with_settings=gathering)
    for number in range(2):
        message = sample(features(number))
        bus.publish(message.key, message.payload, encoding="application/json")
        assert eventually(lambda: pipeline.counts["accepted"] == 1)
    began_s = time.monotonic()
    pipeline.stop() if ends else pipeline.call(lambda: None)
    assert time.monotonic() - began_s < 8.0
    assert store.digest("lab.beam")[1] == (2 if ends else 1)
