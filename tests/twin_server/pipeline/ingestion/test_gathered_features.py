"""However features are gathered and lost, the history is that of single messages."""

import contextlib
import datetime
import threading
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_agent.publish import Publisher, Spool
from edge_agent.settings import Origin, PublishSettings
from slowtime_schemas.batches import is_batch
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.bus.forwarding import ForwardingBus
from slowtime_services.clock import HandClock
from slowtime_services.record import Recorder
from slowtime_services.replay import read_recording
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.pipeline.ingestion.heard import Heard
from twin_server.settings import TwinSettings

NOON_NS = int(datetime.datetime(2026, 3, 10, 12, tzinfo=datetime.UTC).timestamp()) * 10**9
METERED = PublishSettings().of_profile("metered")


class FailingBus(ForwardingBus):
    """A bus that loses what is published while it is cut, whether or not it knows."""

    def __init__(self, bus):
        super().__init__(bus)
        self.cut, self.notices = False, True
        self.features: list[bytes] = []

    @property
    def connected(self):
        return not (self.cut and self.notices)

    def publish(self, key, payload, *, encoding, replayed=False):
        if not self.cut:
            if f"/{FEATURES.name}/" in key:
                self.features.append(payload)
            self._bus.publish(key, payload, encoding=encoding, replayed=replayed)


def publisher_on(bus, folder, clock, chosen=METERED):
    origin = Origin(site="lab", asset="beam", boot="b1", time_base="simulated")
    spool = Spool(folder, "b1", segment_bytes=4096)
    about: dict[str, Any] = {"processing": {}}
    made = Publisher(
        origin, spool, bus, clock, chosen, software="slowtime 0", about=about, link="metered"
    )
    made.open()
    return made


def digest_of(tmp_path, samples):
    with contextlib.closing(SqliteStore(tmp_path / f"{time.monotonic_ns()}.sqlite")) as store:
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.ingest(samples)
        pipeline.give_up()
        return store.digest("lab.beam")


def one_by_one(messages):
    return [Sample(FEATURES.key("lab", "beam"), encode(one), None, False) for one in messages]


@pytest.fixture
def twin_on(tmp_path, settings):
    """Start a twin server on a bus, and end it."""
    with contextlib.ExitStack() as stack:

        def start(bus):
            store = SqliteStore(tmp_path / f"twin-{time.monotonic_ns()}.sqlite")
            stack.callback(store.close)
            pipeline = Pipeline(settings, store, bus=bus)
            pipeline.start()
            stack.callback(pipeline.stop)
            return pipeline, store

        yield start


ACTIONS = st.lists(
    st.sampled_from(
        ["read", "read", "read", "minutes", "tick", "flush", "cut", "lose", "join"]
    ),
    min_size=20,
    max_size=40,
)


@settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(actions=ACTIONS)
def test_any_mixture_of_batches_losses_and_single_messages_gives_the_same_history(
    tmp_path, ageing, twin_on, eventually, actions
):
    messages = ageing(len(actions) + 1)
    with MemoryBus() as memory:
        bus, clock = FailingBus(memory), HandClock(NOON_NS)
        _, store = twin_on(memory)
        publisher = publisher_on(bus, tmp_path / f"spool-{time.monotonic_ns()}", clock)
        made = 0
        for action in [*actions, "join", "read", "flush"]:
            if action == "read" and made < len(messages):
                publisher.features(messages[made])
                made += 1
            elif action == "minutes":
                clock.sleep(400.0)
                publisher.tick()
            elif action == "tick":
                publisher.tick()
            elif action == "flush":
                publisher.flush()
            elif action in ("cut", "lose"):
                bus.cut, bus.notices = True, action == "cut"
            elif action == "join":
                bus.cut = False
        publisher.health()
        assert eventually(lambda: store.count("lab.beam") == made)
        assert store.digest("lab.beam") == digest_of(tmp_path, one_by_one(messages[:made]))
        publisher.close()


def test_what_waits_at_the_agent_is_not_asked_for_and_comes_in_one_batch(
    tmp_path, ageing, twin_on, eventually
):
    with MemoryBus() as memory:
        bus, clock = FailingBus(memory), HandClock(NOON_NS)
        pipeline, store = twin_on(memory)
        publisher = publisher_on(bus, tmp_path / "spool", clock)
        for message in ageing(15):
            publisher.features(message)
            clock.sleep(59.0)
            publisher.tick()
        assert bus.features == []
        publisher.health()
        time.sleep(0.3)  # the server asks within 0.02 s for what it knows to be missing
        assert (store.count("lab.beam"), publisher.counters.get("sent_again", 0)) == (0, 0)
        clock.sleep(15.0)
        publisher.tick()
        assert eventually(lambda: store.count("lab.beam") == 15)
        assert [is_batch(payload) for payload in bus.features] == [True]
        assert publisher.counters.get("sent_again", 0) == 0
        assert eventually(lambda: publisher.wait_acknowledged(0.0, threading.Event()))
        assert pipeline.gauges()["holes"] == 0
        publisher.close()


def test_a_recording_of_batches_holds_single_messages_and_replays_to_the_same_history(
    tmp_path, ageing, eventually
):
    messages, path = ageing(30), tmp_path / "house.mcap"
    with MemoryBus() as bus:
        recorder = Recorder(bus, path)
        publisher = publisher_on(bus, tmp_path / "spool", HandClock(NOON_NS))
        for place, message in enumerate(messages):
            publisher.features(message)
            if place % 7 == 0:
                publisher.flush()
        publisher.close()
        assert eventually(lambda: recorder.recording.counts.get("features") == 30)
        recorder.close()
    recorded = [one.payload for one in read_recording(path, streams=[FEATURES])]
    assert recorded == [encode(message) for message in messages]
    samples = [Sample(FEATURES.key("lab", "beam"), one, None, True) for one in recorded]
    assert digest_of(tmp_path, samples) == digest_of(tmp_path, one_by_one(messages))


def test_readings_of_an_agent_that_gathers_are_late_only_after_the_time_that_it_states(
    tmp_path, ageing, twin_on, eventually
):
    with MemoryBus() as bus:
        clock = HandClock(NOON_NS)
        pipeline, _ = twin_on(bus)
        publisher = publisher_on(bus, tmp_path / "spool", clock)
        for message in ageing(2):
            publisher.features(message)
        publisher.flush()
        assert eventually(lambda: pipeline.link("lab.beam") is not None)
        link = pipeline.link("lab.beam")
        assert (link.features_within_s, link.health_within_s) == (900.0, 900.0)
        assert eventually(lambda: pipeline.heard_ns("lab.beam") is not None)
        pipeline._clock = HandClock(pipeline.heard_ns("lab.beam") + 900 * 10**9)
        assert (pipeline.is_alive("lab.beam"), pipeline.late_s("lab.beam")) == (True, 0)
        pipeline._clock.sleep(61.0)
        assert pipeline.late_s("lab.beam") == 60
        publisher.close()
        assert eventually(lambda: not pipeline.is_alive("lab.beam"))


def test_an_agent_without_a_stated_link_is_late_as_before(twin_on, edge, ageing, eventually):
    with MemoryBus() as bus:
        pipeline, store = twin_on(bus)
        beam = edge(MemoryBus(joins=bus))
        for message in ageing(2):
            beam.make(message)
        old = b'{"version":1,"site":"lab","asset":"beam","boot":"b1","sequence":0,"t_ns":1,'
        old += b'"last_sequence":1,"first_held":0,"uptime_s":0.0}'
        bus.publish(HEALTH.key("lab", "beam"), old, encoding=HEALTH.encoding)
        assert eventually(lambda: store.count("lab.beam") == 2)
        pipeline._clock = HandClock(pipeline.heard_ns("lab.beam") + 61 * 10**9)
        assert pipeline.link("lab.beam") is None
        assert pipeline.late_s("lab.beam") == 60
        beam.close()


def test_gathering_only_delays_when_a_reading_is_overdue():
    heard = Heard.next(Heard.next(None, 0, 0), 60 * 10**9, 60 * 10**9)
    assert heard.late_s((60 + 240) * 10**9) == 180
    assert heard.late_s((60 + 240 + 899) * 10**9, gathered_s=900.0) == 0
    assert heard.late_s((60 + 240 + 900) * 10**9, gathered_s=900.0) == 180


def test_health_states_the_link_only_where_something_is_gathered(tmp_path):
    with MemoryBus() as bus:
        told: list[bytes] = []
        bus.subscribe(HEALTH.everywhere, lambda sample: told.append(sample.payload))
        publisher = publisher_on(bus, tmp_path / "spool", HandClock(NOON_NS))
        publisher.close()
        link = Health.model_validate_json(told[-1], strict=True).link
        assert link is not None
        assert (link.profile, link.offline_within_s, link.budget_bytes) == (
            "metered",
            120,
            None,
        )
