"""What never reached the recorder is asked for; what nobody has any more is counted."""

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH, request_key
from slowtime_services.bus import MemoryBus
from slowtime_services.record import Recorder
from slowtime_services.record.retransmission import Retransmission
from slowtime_services.replay import read_recording

KEY = FEATURES.key("lab", "beam")


class Edge:
    """An edge that loses some of what it publishes and answers for what it holds."""

    def __init__(self, bus, messages, held=None):
        self.bus, self.asked = bus, []
        self.messages = {m.sequence: encode(m) for m in messages}
        self.held = set(self.messages) if held is None else held
        bus.answer(request_key("lab", "beam", "features"), self.answer)

    def answer(self, query):
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        self.asked.append((query.parameters["boot"], first, last))
        for sequence in range(first, last + 1):
            if sequence in self.held:
                yield KEY, self.messages[sequence]

    def publish(self, *sequences):
        for sequence in sequences:
            self.bus.publish(KEY, self.messages[sequence], encoding=FEATURES.encoding)

    def say_health(self, last):
        health = Health(
            site="lab",
            asset="beam",
            boot="b1",
            sequence=0,
            t_ns=1,
            last_sequence=last,
            first_held=0,
            uptime_s=1.0,
        )
        self.bus.publish(HEALTH.key("lab", "beam"), encode(health), encoding=HEALTH.encoding)


def recorded(path):
    return [json.loads(m.payload)["sequence"] for m in read_recording(path, streams=[FEATURES])]


def test_a_gap_is_asked_for_and_recorded(tmp_path, features_of, eventually):
    bus = MemoryBus()
    edge = Edge(bus, features_of(20))
    with Recorder(bus, tmp_path / "a.mcap") as recorder:
        edge.publish(0, 1, 2, 6, 7, 9)
        assert eventually(lambda: recorder.recording.counts.get("features") == 10)
        assert recorder.recording.missing == 0
    assert recorded(tmp_path / "a.mcap") == [0, 1, 2, 6, 7, 9, 3, 4, 5, 8]
    assert edge.asked == [("b1", 3, 5), ("b1", 8, 8)]


def test_a_lost_end_is_noticed_by_the_health_message_and_asked_for_before_closing(
    tmp_path, features_of
):
    bus = MemoryBus()
    edge = Edge(bus, features_of(20))
    with Recorder(bus, tmp_path / "a.mcap"):
        edge.publish(0, 1)
        edge.say_health(4)
    assert recorded(tmp_path / "a.mcap") == [0, 1, 2, 3, 4]


def test_what_closes_by_itself_is_not_asked_for(tmp_path, features_of):
    bus = MemoryBus()
    edge = Edge(bus, features_of(20))
    with Recorder(bus, tmp_path / "a.mcap"):
        edge.publish(0, 3, 1, 2, 4, 5, 5, 0)
    assert edge.asked == []


def test_what_was_sent_before_the_recording_began_is_not_asked_for(tmp_path, features_of):
    bus = MemoryBus()
    edge = Edge(bus, features_of(20))
    with Recorder(bus, tmp_path / "a.mcap"):
        edge.publish(12, 13)
        edge.say_health(13)
    assert edge.asked == []


def test_what_nobody_holds_any_more_is_counted_and_said(tmp_path, features_of, caplog):
    bus = MemoryBus()
    edge = Edge(bus, features_of(20), held={4})
    with Recorder(bus, tmp_path / "a.mcap") as recorder:
        edge.publish(0, 6)
    assert recorded(tmp_path / "a.mcap") == [0, 6, 4]
    assert recorder.recording.missing == 4
    assert "4 features that never arrived" in caplog.text


def test_a_gap_is_asked_for_ever_more_rarely_and_then_given_up(features_of):
    bus = MemoryBus()
    edge = Edge(bus, features_of(9), held=set())
    healer = Retransmission(bus, lambda sample: None, grace_s=0.01, tries=3)
    for sequence in (0, 8):
        healer.note(KEY, edge.messages[sequence])
    healer.heal()
    assert edge.asked == []
    deadline = time.monotonic() + 300
    asked: list[tuple[float, float]] = []
    while len(edge.asked) < 3 and time.monotonic() < deadline:
        before, count = time.monotonic(), len(edge.asked)
        healer.heal()
        if len(edge.asked) > count:
            asked.append((before, time.monotonic()))
        time.sleep(0.001)
    assert asked[1][1] - asked[0][0] >= 0.02
    assert asked[2][1] - asked[1][0] >= 0.04
    time.sleep(0.1)
    healer.heal()
    assert len(edge.asked) == 3
    assert healer.missing == 7


@given(order=st.permutations(range(12)), cut=st.integers(1, 12))
def test_the_account_of_what_is_missing_is_exact(order, cut):
    healer = Retransmission(MemoryBus(), lambda sample: None)
    come = order[:cut]
    for sequence in come:
        payload = {"site": "lab", "asset": "beam", "boot": "b1", "sequence": sequence}
        healer.note(KEY, json.dumps(payload).encode())
    expected = set(range(come[0], max(come) + 1)) - set(come)
    assert healer.missing == len(expected)
    asked = {s for _, gap in healer._due(at_last=True) for s in range(gap.first, gap.last + 1)}
    assert asked == expected


@pytest.mark.parametrize("payload", [b"{", b"[]", b'{"site": 1}', b"\xff"])
def test_what_cannot_be_read_is_no_part_of_the_account(payload):
    healer = Retransmission(MemoryBus(), lambda sample: None)
    healer.note(KEY, payload)
    healer.note(HEALTH.key("lab", "beam"), payload)
    assert healer.missing == 0
