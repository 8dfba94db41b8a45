"""A recording played to a receiver, however slow or deaf, arrives whole and in its order."""

import functools
import math
import threading

import pytest

from slowtime_schemas.streams import ABOUT, FEATURES, HEALTH, alive_key, request_key
from slowtime_services.bus import MemoryBus, ZenohBus
from slowtime_services.clock import HandClock
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import RecordingError, ReplayProgress, read_recording, replay


@pytest.fixture(params=["memory", "zenoh"])
def buses(request, endpoint):
    """The bus of the replay and that of the receiver."""
    if request.param == "memory":
        with MemoryBus() as one, MemoryBus(joins=one) as other:
            yield one, other
    else:
        with ZenohBus("client", [endpoint]) as near, ZenohBus("client", [endpoint]) as far:
            yield near, far


def test_everything_arrives_once_and_in_order(buses, house, ledger):
    path, expected = house(600)
    twin = ledger(buses[1])
    played = replay(path, buses[0], speed=math.inf)
    assert twin.kept == expected
    recorded = [m.payload for m in read_recording(path, streams=[FEATURES])]
    assert [twin.kept[run][sequence] for run, sequence in twin.order] == recorded
    assert played.complete
    assert (played.features, played.acknowledged) == (1500, 1500)
    assert all(twin.replayed)


@pytest.mark.long
def test_a_slow_receiver_loses_nothing(buses, house, ledger):
    path, expected = house(400)
    twin = ledger(buses[1], per_s=1000, inbox_items=150)
    played = replay(path, buses[0], speed=math.inf, window=50, patience_s=60.0)
    assert twin.kept == expected
    assert played.complete
    assert twin.inbox.dropped == 0


def test_a_lost_acknowledgement_is_asked_for_again(buses, house, ledger):
    path, expected = house(200)
    twin = ledger(buses[1], mute=52)
    played = replay(path, buses[0], speed=math.inf, window=50, patience_s=60.0)
    assert twin.kept == expected
    assert played.complete
    assert played.duration_s < 60.0


@pytest.mark.long
def test_what_the_receiver_missed_it_can_ask_for_the_lost_end_too(buses, house, ledger):
    path, expected = house(300)
    twin = ledger(buses[1], deaf=[3, 17, 18, 299, 339])
    played = replay(path, buses[0], speed=math.inf, window=5000)
    assert twin.asked > 0
    assert twin.kept == expected
    assert played.complete


def test_an_inbox_that_overflows_is_healed(buses, house, ledger):
    path, expected = house(400)
    twin = ledger(buses[1], per_s=2000, inbox_items=100)
    played = replay(path, buses[0], speed=math.inf, window=5000)
    assert twin.inbox.dropped > 0
    assert twin.kept == expected
    assert played.complete


def test_the_account_lists_only_what_has_been_played(house, ledger):
    path, _ = house(100)
    bus = MemoryBus()
    seen: list[tuple[object, ...]] = []
    twin = ledger(bus)

    def look(sample):
        if len(seen) < 3 and sample.key == FEATURES.key("lab", "fan"):
            seen.append((twin.account("lab", "beam"), twin.account("lab", "fan")))

    bus.subscribe(FEATURES.everywhere, look)
    replay(path, bus, speed=math.inf)
    assert seen[0] == (
        [{"boot": "b1", "first": 0, "last": 99}],
        [{"boot": "f1", "first": 40, "last": 40}],
    )
    assert seen[2][1] == [{"boot": "f1", "first": 40, "last": 42}]


@pytest.mark.long
def test_what_has_not_been_played_is_not_answered(house):
    path, _ = house(100)
    bus = MemoryBus()
    answered: list[int] = []

    def ask(sample):
        parameters = {"boot": "f1", "first": "41", "last": "1000000"}
        answered.append(len(bus.ask(request_key("lab", "fan", "features"), parameters)))

    bus.subscribe(FEATURES.key("lab", "fan"), ask)
    replay(path, bus, speed=math.inf, patience_s=0.1)
    assert answered == list(range(100))


def test_the_assets_are_alive_while_they_are_played(house):
    path, _ = house(10)
    bus = MemoryBus()
    changes: list[object] = []
    bus.watch("slowtime/**", lambda *change: changes.append(change))
    bus.subscribe(FEATURES.everywhere, lambda sample: changes.append("features"))
    replay(path, bus, speed=math.inf, patience_s=0.1)
    beam, fan = alive_key("lab", "beam"), alive_key("lab", "fan")
    assert changes[:3] == [(beam, True), (fan, True), "features"]
    assert set(changes[-2:]) == {(beam, False), (fan, False)}


def test_where_nobody_confirms_it_plays_on_and_says_so(house):
    path, _ = house(100)
    bus = MemoryBus()
    got: list[object] = []
    bus.subscribe(FEATURES.everywhere, got.append)
    played = replay(path, bus, speed=math.inf, window=20, patience_s=0.2)
    assert len(got) == played.features == 250
    assert played.acknowledged == 0
    assert not played.complete
    assert played.duration_s < 25  # not 0.2 s for each of 250


def _stamp(now_ns, keep, _sample):
    keep(now_ns())


def test_the_pace_is_that_of_the_recording_times_speed(house):
    path, _ = house(100)
    for speed, expected_s in ((1.0, 2.49), (10.0, 0.249)):
        clock, bus = HandClock(0), MemoryBus()
        stamps: list[int] = []
        bus.subscribe(
            FEATURES.everywhere, functools.partial(_stamp, clock.now_ns, stamps.append)
        )
        replay(path, bus, speed=speed, clock=clock, window=10**6, patience_s=0.05)
        assert stamps[-1] / 1e9 == pytest.approx(expected_s, rel=1e-6)
        assert stamps == sorted(stamps)


def test_progress_ends_at_the_total(house):
    path, _ = house(100)
    reports: list[ReplayProgress] = []
    played = replay(
        path,
        MemoryBus(),
        speed=math.inf,
        progress=reports.append,
        window=10**6,
        patience_s=0.05,
    )
    assert reports[-1].done == reports[-1].total == 250 + 5
    assert played.counts == {"features": 250, "health": 5}


def test_it_can_be_stopped_at_any_moment(house):
    path, _ = house(100)
    bus, stop = MemoryBus(), threading.Event()
    got: list[object] = []

    def count(sample):
        got.append(sample)
        if len(got) == 7:
            stop.set()

    bus.subscribe(FEATURES.everywhere, count)
    played = replay(path, bus, speed=math.inf, stop=stop)
    assert len(got) == 7
    assert played.stopped
    assert not played.complete


def test_streams_can_be_chosen(house):
    path, _ = house(100)
    bus = MemoryBus()
    got: list[object] = []
    bus.subscribe("slowtime/**", got.append)
    played = replay(path, bus, speed=math.inf, streams=[HEALTH, ABOUT])
    assert played.counts == {"health": 5}
    assert len(got) == 5


def test_a_message_that_cannot_be_read_is_played_as_it_is(tmp_path):
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for payload in (b"{", b"[]", b'{"site": 1}', b"\xff"):
            writer.write(FEATURES, "lab", "beam", payload, 1)
            writer.write(HEALTH, "lab", "beam", payload, 1)
    bus = MemoryBus()
    got: list[object] = []
    bus.subscribe(FEATURES.everywhere, lambda s: got.append(s.payload))
    played = replay(tmp_path / "a.mcap", bus, speed=math.inf)
    assert got == [b"{", b"[]", b'{"site": 1}', b"\xff"]
    assert played.features == 0


@pytest.mark.parametrize(
    "wrong", [{"speed": 0}, {"speed": 1e-6}, {"speed": -1}, {"speed": math.nan}, {"window": 0}]
)
def test_a_pace_that_cannot_be_is_refused(house, wrong):
    path, _ = house(20)
    with pytest.raises(ValueError, match=r"Give a speed of at least 0\.001"):
        replay(path, MemoryBus(), **wrong)


def test_a_broken_recording_is_refused_before_anything_is_published(house):
    path, _ = house(50)
    path.write_bytes(path.read_bytes()[:-100])
    bus = MemoryBus()
    got: list[object] = []
    bus.subscribe("slowtime/**", got.append)
    with pytest.raises(RecordingError, match="slowtime mcap recover"):
        replay(path, bus)
    assert not got
