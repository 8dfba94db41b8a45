"""Recordings that state anything: stamps decades apart, ranges and boots without end."""

import math
import threading
from pathlib import Path

import pytest

import slowtime_services
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Accepted, Acknowledgement, LedgerUpdate, SignedHead
from slowtime_schemas.streams import ACK, FEATURES, request_key
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.clock import HandClock
from slowtime_services.ledger import Entry, beginning, linked
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import (
    RecordingError,
    feature_holdings,
    ledger_check,
    read_recording,
    replay,
)
from slowtime_services.replay.ledger_check import LedgerCheck
from slowtime_services.replay.player import LONGEST_PAUSE_S
from tests.state_machines import steps_in

FOLDER = Path(slowtime_services.__file__).parent
YEAR_NS = 365 * 86_400 * 10**9
NOW_NS = 56 * YEAR_NS


@pytest.fixture
def recorded(tmp_path, features_of):
    """A recording of features, each with the stamp of its arrival."""

    def make(stamps_ns, boots=None):
        path = tmp_path / "one.mcap"
        messages = features_of(len(stamps_ns))
        with RecordingWriter(path) as writer:
            for n, (message, log_ns) in enumerate(zip(messages, stamps_ns, strict=True)):
                if boots is not None:
                    message = message.model_copy(update={"boot": f"b{boots[n]}", "sequence": 0})
                writer.write(FEATURES, "lab", "beam", encode(message), log_ns)
        return path

    return make


@pytest.mark.parametrize("speed", [1.0, 1e-3, 1e6])
@pytest.mark.parametrize(
    "stamps_ns",
    [
        [0, NOW_NS, NOW_NS + 1],
        [NOW_NS, 0, NOW_NS, 0],
        [NOW_NS, 2**63 - 1, 5],
        [2**63 - 1] * 3,
    ],
)
def test_stamps_that_are_decades_apart_cost_an_hour_at_most(recorded, stamps_ns, speed):
    clock = HandClock(NOW_NS)
    played = replay(recorded(stamps_ns), MemoryBus(), speed=speed, clock=clock, patience_s=0.0)
    assert played.counts["features"] == len(stamps_ns)
    passed_s = (clock.now_ns() - NOW_NS) / 1e9
    assert passed_s <= LONGEST_PAUSE_S * (len(stamps_ns) - 1) + 1


class Wound(HandClock):
    """A clock that is set back by a year while it is waited on."""

    slept_s = 0.0

    def sleep(self, seconds):
        self.slept_s += seconds
        super().sleep(seconds)
        if self.now_ns() > NOW_NS + 10**9:
            self.set_ns(self.now_ns() - YEAR_NS)


def test_a_clock_that_is_set_back_meanwhile_costs_an_hour_at_most(recorded):
    path, clock = recorded([0, 2 * 10**9, 3 * 10**9]), Wound(NOW_NS)
    replay(path, MemoryBus(), clock=clock, patience_s=0.0)
    assert clock.slept_s <= LONGEST_PAUSE_S + 10


@pytest.mark.parametrize("log_ns", [2**63, 2**64 - 1])
def test_a_message_stamped_after_2262_is_refused_as_damage(recorded, log_ns):
    path = recorded([0, log_ns])
    with pytest.raises(RecordingError, match="stamped after the year 2262"):
        list(read_recording(path))
    with pytest.raises(RecordingError, match="stamped after the year 2262"):
        replay(path, MemoryBus(), speed=math.inf)


def test_boots_without_end_cost_as_much_each_as_one(recorded):
    def steps(count):
        path = recorded([n * 10**6 for n in range(count)], boots=range(count))
        with steps_in(FOLDER) as found:
            replay(path, MemoryBus(), speed=math.inf, window=10, patience_s=0.0)
        path.unlink()
        return found.count / count

    assert steps(1_600) < 2 * steps(200)


def test_no_more_is_sent_again_at_once_than_an_edge_sends(recorded, monkeypatch):
    monkeypatch.setattr(feature_holdings, "MOST_AT_ONCE", 7)
    bus, asked = MemoryBus(), list[Sample]()

    def ask(progress):
        if progress.done == progress.total and not asked:
            parameters = {"boot": "b1", "first": "2", "last": str(2**62)}
            asked.extend(bus.ask(request_key("lab", "beam", "features"), parameters))

    replay(
        recorded(range(20)), MemoryBus(joins=bus), speed=math.inf, patience_s=0.0, progress=ask
    )
    assert len(asked) == 7


def test_what_was_not_sent_is_not_taken_as_confirmed(recorded):
    bus, stop = MemoryBus(), threading.Event()

    def confirm(sample):
        ack = Acknowledgement(
            site="lab", asset="beam", boot="b1", sequence=2**40 - 1, t_ns=0
        )  # fmt: skip
        bus.publish(ACK.key("lab", "beam"), encode(ack), encoding=ACK.encoding)
        stop.set()

    bus.subscribe(FEATURES.everywhere, confirm)
    played = replay(recorded(range(9)), MemoryBus(joins=bus), speed=math.inf, stop=stop)
    assert (played.features, played.acknowledged, played.complete) == (9, 1, False)


def update(*accepted, count, after=0):
    zeros = "0" * 64
    head = SignedHead(
        number=1, t_ns=0, assets=1, root=zeros, previous=zeros, public="", signature=""
    )
    return LedgerUpdate(
        site="lab", asset="beam", boot="b", sequence=0, t_ns=0, count=count, link=zeros,
        history_count=0, history=zeros, accepted_after=after, accepted=accepted, head=head,
    )  # fmt: skip


def features(first, last):
    return Accepted(kind="f", boot="b1", number=1, first=first, last=last)


def followed(message, held, before=None):
    found, vouched = LedgerCheck(), set[tuple[str, int]]()
    digests = {("b1", n): bytes([n % 256]) * 32 for n in held}
    with steps_in(FOLDER) as steps:
        ledger_check._follow(ledger_check._Held(digests), before, message, vouched, found)
    return found, vouched, steps.count


@pytest.mark.parametrize("last", [10**4, 2**40, 2**62])
def test_a_range_that_a_head_states_is_compared_and_not_gone_through(last):
    found, vouched, steps = followed(update(features(0, last), count=last + 1), range(50))
    assert steps < 2_000
    assert not vouched
    assert found.missing or found.wrong


def test_ranges_that_are_stated_again_and_again_are_refused():
    ranges = [features(0, 999)] * 1_000
    found, vouched, steps = followed(update(*ranges, count=10**6), range(1_000))
    assert steps < 100_000
    assert "20000 are listed at most" in found.wrong[0]
    assert not vouched


def test_a_server_that_was_started_again_lists_rows_twice_and_each_is_followed_once():
    entries = [Entry("f", (1 << 40) + n, bytes([n]) * 32) for n in range(20)]
    links = [linked(beginning("lab.beam"), entries[:n]) for n in range(21)]
    first = update(features(0, 9), count=10).model_copy(update={"link": links[10].digest.hex()})
    again = update(features(0, 19), count=20).model_copy(
        update={"link": links[20].digest.hex()}
    )
    found, vouched, _ = followed(first, range(20))
    assert (found.wrong, len(vouched)) == ([], 10)
    found, vouched, _ = followed(again, range(20), before=first)
    assert (found.wrong, vouched) == ([], {("b1", n) for n in range(10, 20)})
