"""Spools, agents and servers that go wrong: whatever is not in the history is in an event."""

import contextlib
import json
import random
import time

import pytest

from edge_agent.publish import Publisher, Spool
from edge_agent.settings import Origin, PublishSettings
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import SystemClock
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
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


def history(pipeline):
    rows = pipeline.store.messages(TWIN, (0, -1), 10**6)
    return [(json.loads(row.message)["boot"], row.sequence) for row in rows]


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
