"""Spools, agents and servers that go wrong: whatever is not in the history is in an event."""

import contextlib
import json
import random
import time

import pytest

from edge_agent.publish import Publisher, Spool
from edge_agent.settings import Origin, PublishSettings
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Acknowledgement, Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ACK, FEATURES, STATE, server_key
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.clock import SystemClock
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline, TwinKnowledge
from twin_server.settings import TwinSettings

DAY_NS = 86_400 * 10**9
TWIN = "lab.beam"
HASTY = {"grace_s": 0.02, "backoff_s": 0.02, "max_backoff_s": 0.1, "tries": 2}


def eventually(condition, timeout_s=120.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def features(sequence, *, boot="b1", t_ns=None, frequency_hz=3.0, time_base="live"):
    t_ns = time.time_ns() - 10**10 + sequence * 10**6 if t_ns is None else t_ns
    mode = Mode(
        frequency_hz=Quantity(value=frequency_hz + sequence * 1e-5, sd=0.002),
        damping_ratio=Quantity(value=0.02, sd=0.001),
    )
    return Features(
        site="lab",
        asset="beam",
        boot=boot,
        sequence=sequence,
        t_ns=t_ns,
        start_ns=t_ns,
        slow_time=float(sequence),
        time_base=time_base,
        method="ambient",
        modes=(mode,),
        quality=Quality(samples=1000),
    )


class House:
    """Agents and twin servers in one process, each on a bus that joins the others."""

    def __init__(self, home):
        self.home, self.bus = home, MemoryBus()
        self._stack = contextlib.ExitStack()
        self._stack.callback(self.bus.close)

    def agent(self, boot, spool="spool"):
        bus = MemoryBus(joins=self.bus)
        publisher = Publisher(
            Origin(site="lab", asset="beam", boot=boot),
            Spool(self.home / spool, boot, segment_bytes=4096),
            bus,
            SystemClock(),
            PublishSettings(),
            software="slowtime 0",
            about={"processing": {}},
        )
        publisher.open()
        self._stack.callback(publisher.close)
        return publisher

    def twin(self, name="twin", **more):
        store = SqliteStore(self.home / f"{name}.sqlite")
        self._stack.callback(store.close)
        settings = TwinSettings(healing=HASTY, **more)
        pipeline = Pipeline(settings, store, bus=MemoryBus(joins=self.bus))
        pipeline.start()
        self._stack.callback(pipeline.stop)
        return pipeline

    def close(self):
        self._stack.close()


@pytest.fixture
def house(tmp_path):
    house = House(tmp_path)
    yield house
    house.close()


def spooled(folder, boot, messages):
    """Leave a spool as an agent that was offline would."""
    spool = Spool(folder, boot, segment_bytes=64 * 1024)
    for message in messages:
        spool.append(message.sequence, encode(message))
    spool.close()


def events(pipeline, kind):
    found = (json.loads(row.body) for row in pipeline.store.events(TWIN, limit=100_000))
    return [event for event in found if event["kind"] == kind]


def rows_of(store):
    rows = store.messages(TWIN, (0, -1), 10**6)
    return [((json.loads(row.message)["boot"], row.sequence), row.message) for row in rows]


def history(pipeline):
    return [key for key, _ in rows_of(pipeline.store)]


def messages_of(database):
    with contextlib.closing(SqliteStore(database)) as store:
        return rows_of(store)


def history_of(database):
    return [key for key, _ in messages_of(database)]


def reported_lost(pipeline):
    return {
        (event["details"]["boot"], sequence)
        for event in events(pipeline, "features_lost")
        for sequence in range(event["details"]["first"], event["details"]["last"] + 1)
    }


def test_bits_flipped_at_200_places_of_a_spool_cost_their_records_and_each_is_in_an_event(
    house, tmp_path
):
    messages = [features(n) for n in range(600)]
    spooled(tmp_path / "spool", "b1", messages)
    rng = random.Random(30)
    records = {(m.boot, m.sequence): encode(m) for m in messages}
    paths = sorted((tmp_path / "spool").glob("*.spool"))
    for path in paths:
        data = bytearray(path.read_bytes())
        for place in rng.sample(range(len(data) * 8), -(-200 // len(paths))):
            data[place // 8] ^= 1 << place % 8
        path.write_bytes(data)
    house.agent("b2").features(features(0, boot="b2", t_ns=time.time_ns()))
    twin = house.twin()
    assert eventually(lambda: ("b2", 0) in history(twin))
    arrived, lost = set(history(twin)), reported_lost(twin)
    assert arrived | lost == {*records, ("b2", 0)}
    assert not arrived & lost
    assert 0 < len(lost) <= 204
    assert {event["severity"] for event in events(twin, "features_lost")} == {"warning"}
    assert eventually(lambda: len(list((tmp_path / "spool").glob("*.b1.*.spool"))) == 0)
    assert list((tmp_path / "spool").glob("*.damaged"))


def test_what_a_spool_has_held_for_31_days_is_taken_in_by_its_sensor_time(house, tmp_path):
    begins = time.time_ns() - 31 * DAY_NS
    old = [features(n, t_ns=begins + n * DAY_NS // 4) for n in range(120)]
    spooled(tmp_path / "spool", "b1", old)
    twin = house.twin()
    house.agent("b2").features(features(0, boot="b2", t_ns=time.time_ns()))
    assert eventually(lambda: len(history(twin)) == 121)
    assert history(twin) == [*(("b1", n) for n in range(120)), ("b2", 0)]
    assert [row.t_ns for row in twin.store.messages(TWIN, (0, -1), 120)] == [
        m.t_ns for m in old
    ]
    assert not reported_lost(twin)
    (event,) = events(twin, "old_readings")
    assert event["severity"] == "warning"
    assert (event["details"]["boot"], event["details"]["first"]) == ("b1", 0)
    assert 30.9 < event["details"]["age_days"] < 31.1
    assert eventually(lambda: not list((tmp_path / "spool").glob("*.b1.*.spool")))


def test_a_running_agent_whose_sensor_is_31_days_behind_loses_nothing_either(house):
    twin = house.twin()
    agent = house.agent("b1")
    behind = time.time_ns() - 31 * DAY_NS
    for n in range(20):
        agent.features(features(n, t_ns=behind + n * 10**9))
    assert eventually(lambda: len(history(twin)) == 20)
    assert not reported_lost(twin)
    assert len(events(twin, "old_readings")) == 1


def in_spool(folder, boot):
    """Sequences of a boot that are still in a spool, as its next agent would read them."""
    spool = Spool(folder, f"reader-{time.monotonic_ns()}")
    held = {json.loads(payload)["sequence"] for payload in spool.read(boot)}
    spool.close()
    return held


def test_two_agents_of_one_asset_are_named_and_neither_loses_what_it_has(house, tmp_path):
    twin = house.twin()
    one, other = house.agent("b1", "one"), house.agent("b2", "other")
    for n in range(10):
        one.features(features(n))
    assert eventually(lambda: len(history(twin)) == 10)
    for n in range(30):
        other.features(features(n, boot="b2", frequency_hz=5.0))
        one.features(features(10 + n))
    assert eventually(lambda: history(twin).count(("b2", 29)) == 1)
    assert eventually(lambda: (one.health(), other.health(), events(twin, "two_agents"))[-1])
    (event,) = events(twin, "two_agents")
    assert event["details"]["boots"] == ["b1", "b2"]
    assert "boot b1 goes on although boot b2 has begun" in event["message"]
    house.close()
    arrived = set(history_of(tmp_path / "twin.sqlite"))
    for boot, folder, made in (("b1", "one", 40), ("b2", "other", 30)):
        kept = {(boot, n) for n in in_spool(tmp_path / folder, boot)}
        assert {(boot, n) for n in range(made)} <= arrived | kept


@pytest.mark.parametrize("as_an_earlier_boot", [False, True])
def test_a_server_that_starts_again_compares_what_an_agent_holds_with_its_history(
    house, tmp_path, as_an_earlier_boot
):
    twin = house.twin()
    one = house.agent("b1", "one")
    for n in range(20):
        one.features(features(n))
    assert eventually(lambda: len(history(twin)) == 20)
    one.close()
    twin.stop()
    twin.store.close()
    yours = [features(n, frequency_hz=5.0) for n in range(12)]
    if as_an_earlier_boot:
        spooled(tmp_path / "other", "b1", yours)
        other = house.agent("b2", "other")
    else:
        other = house.agent("b1", "other")
        for message in yours:
            other.features(message)
    twin = house.twin()
    assert eventually(lambda: (other.health(), events(twin, "two_agents"))[-1])
    assert events(twin, "two_agents")[0]["details"]["boots"] == ["b1", "b1"]
    house.close()
    assert in_spool(tmp_path / "other", "b1") == set(range(12))


@pytest.mark.parametrize("restarted", [False, True], ids=["at once", "one after the other"])
def test_two_agents_under_one_boot_are_named_and_neither_loses_what_it_has(
    house, tmp_path, restarted
):
    twin = house.twin()
    one = house.agent("b1", "one")
    mine = [features(n) for n in range(40)]
    yours = [features(n, frequency_hz=5.0) for n in range(25)]
    for message in mine[:20]:
        one.features(message)
    assert eventually(lambda: len(history(twin)) == 20)
    if restarted:
        one.close()
        mine = mine[:20]
    time.sleep(1.2)  # an agent that begins within the same second is told by its readings only
    other = house.agent("b1", "other")
    for message in yours:
        other.features(message)
    if not restarted:
        for message in mine[20:]:
            one.features(message)
    assert eventually(lambda: events(twin, "two_agents"))
    other.health()
    assert eventually(lambda: twin.gauges()["inbox"] == 0)
    (event,) = events(twin, "two_agents")
    assert event["details"]["boots"] == ["b1", "b1"]
    assert "began at" in event["message"] or "sensor time" in event["message"]
    house.close()
    arrived = {payload for _, payload in messages_of(tmp_path / "twin.sqlite")}
    for folder, made in (("one", mine), ("other", yours)):
        kept = in_spool(tmp_path / folder, "b1")
        for message in made:
            assert encode(message) in arrived or message.sequence in kept, (folder, message)


@pytest.mark.parametrize("together", [False, True])
def test_other_content_under_a_known_number_is_noticed_without_any_word_of_health(
    house, together
):
    twin = house.twin()
    mine = [features(n) for n in range(5)]
    yours = [features(n, frequency_hz=5.0) for n in range(5)]
    samples = [
        Sample(FEATURES.key("lab", "beam"), encode(message), None, False)
        for message in [*mine, *mine, *yours[3:]]
    ]
    for batch in [samples] if together else [samples[:7], samples[7:]]:
        twin.ingest(batch)
        assert eventually(lambda: len(history(twin)) == 5)
    (event,) = events(twin, "two_agents")
    assert "reading 3 came" in event["message"]
    assert twin.refusals.counts["two_agents"] >= 1
    assert [payload for _, payload in rows_of(twin.store)] == [encode(m) for m in mine]


def test_an_agent_that_hears_of_features_it_has_not_made_deletes_nothing(house, tmp_path):
    agent = house.agent("b1")
    for n in range(3):
        agent.features(features(n))
    for word in (
        {"sequence": 900},
        {"sequence": 2, "first": 0, "digest": "0" * 16},
        {"sequence": 2},
    ):
        ack = Acknowledgement(site="lab", asset="beam", boot="b1", t_ns=1, **word)
        house.bus.publish(ACK.key("lab", "beam"), encode(ack), encoding=ACK.encoding)
    assert agent.counters["foreign_acks"] == 2
    agent.close()
    assert in_spool(tmp_path / "spool", "b1") == {0, 1, 2}
    assert json.loads((tmp_path / "spool" / "withheld.json").read_text()) == {"b1": 900}


def test_an_agent_of_before_is_acknowledged_in_the_version_that_it_reads(house):
    heard = []
    house.bus.subscribe(ACK.everywhere, lambda sample: heard.append(json.loads(sample.payload)))
    twin = house.twin()
    message = features(0)
    house.bus.publish(FEATURES.key("lab", "beam"), encode(message), encoding=FEATURES.encoding)
    assert eventually(lambda: heard)
    assert (heard[0]["version"], heard[0]["sequence"]) == (1, 0)
    assert set(heard[0]) == {"version", "site", "asset", "boot", "sequence", "t_ns"}
    agent = house.agent("b2")
    agent.features(features(0, boot="b2"))
    assert eventually(lambda: ("b2", 0) in history(twin))
    assert eventually(lambda: any(ack["version"] == 2 for ack in heard))


def test_a_second_server_on_the_bus_says_so_and_acknowledges_and_publishes_nothing(
    house, tmp_path, caplog
):
    heard = []
    for stream in (ACK, STATE):
        house.bus.subscribe(stream.everywhere, lambda sample: heard.append(sample.key))
    first = house.twin("first")
    assert eventually(lambda: first.trouble == "" and "announced" in seen(house))
    second = house.twin("second")
    assert eventually(lambda: "Another twin server was already on this bus" in second.trouble)
    logged = (
        "Another twin server was already on this bus",
        "A second twin server is on this bus",
    )
    assert eventually(lambda: all(any(x in m for m in caplog.messages) for x in logged))
    assert first.trouble == ""
    first.stop()
    assert eventually(lambda: second.trouble == "")
    gone = "this one publishes from now on"
    assert eventually(lambda: any(gone in text for text in caplog.messages))
    third = house.twin("third")
    agent = house.agent("b1")
    for n in range(5):
        agent.features(features(n))
    assert eventually(lambda: len(history(second)) == len(history(third)) == 5)
    assert eventually(lambda: heard.count(STATE.key("lab", "beam")) >= 5)
    assert heard.count(STATE.key("lab", "beam")) == 5
    assert second.counts["published"] > 0 == third.counts["published"]
    knowledge = TwinKnowledge(third, third.store, bus=house.bus)
    assert any("Stop one of the two" in trouble for trouble in knowledge.troubles())


def seen(house):
    found = []
    house.bus.watch(server_key("*"), lambda key, alive: found.append("announced")).close()
    return found


def test_what_is_lost_for_its_sensor_time_is_reported_with_that_reason(house):
    twin = house.twin()
    agent = house.agent("b1")
    for n in range(6):
        agent.features(features(n, t_ns=10**9 if n in (2, 3) else None))
    assert eventually(lambda: len(history(twin)) == 4)
    (event,) = events(twin, "features_lost")
    assert (event["details"]["first"], event["details"]["last"]) == (2, 3)
    assert event["details"]["why"] == "its sensor time is not believed (unset_clock)"
