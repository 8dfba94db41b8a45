"""What other processes send is bounded: answers, messages of any size, addresses, agents."""

import time

import pytest

from slowtime_schemas.streams import FEATURES, alive_key
from slowtime_services.bus import Inbox, MemoryBus, TwoVersionBus, ZenohBus, key_versions
from slowtime_services.bus import protocol as bus_protocol
from slowtime_services.bus import zenoh as zenoh_bus
from slowtime_services.bus.keys import InvalidKeyError


def test_answers_without_end_are_read_up_to_a_bound_and_that_is_told(pair, monkeypatch):
    monkeypatch.setattr(bus_protocol, "MOST_ANSWERED_BYTES", 20_000)

    def answer(query):
        for _ in range(1_000):
            yield "slowtime/test/a", b"x" * 488

    pair.one.answer("slowtime/test/a", answer)
    deadline = time.monotonic() + 60
    answers = pair.other.ask("slowtime/test/a")
    while not answers and time.monotonic() < deadline:
        answers = pair.other.ask("slowtime/test/a")
    assert len(answers) == 21
    assert answers.errors == ("More than 20,000 bytes were answered; the rest was not read.",)
    assert len(pair.other.ask("slowtime/test/a")) == 21  # and the bus goes on


def test_a_message_larger_than_any_stream_is_left_out_and_the_connection_stays(
    endpoint, monkeypatch, eventually
):
    with ZenohBus("client", [endpoint]) as sender:
        monkeypatch.setattr(zenoh_bus, "MOST_MESSAGE_BYTES", 100_000)
        with ZenohBus("client", [endpoint]) as receiver:
            inbox = Inbox()
            receiver.subscribe(
                "slowtime/test/large", lambda sample: inbox.put(len(sample.payload))
            )
            assert eventually(
                lambda: sender.publish("slowtime/test/large", b"1", encoding="") or len(inbox)
            )
            for size in (90_000, 1_000_000, 50_000):
                sender.publish("slowtime/test/large", bytes(size), encoding="")
            came = []
            assert eventually(lambda: came.extend(inbox.take()) or 50_000 in came)
            assert [size for size in came if size > 1] == [90_000, 50_000]


def test_an_address_of_kilobytes_is_refused_by_the_bus_of_one_process():
    with MemoryBus() as bus, pytest.raises(InvalidKeyError, match="up to 1024"):
        bus.publish("slowtime/" + "a/" * 30_000 + "b", b"", encoding="")


def test_agents_of_the_former_version_are_known_up_to_a_number(monkeypatch):
    monkeypatch.setattr(key_versions, "MOST_FORMER", 10)
    with MemoryBus() as one, TwoVersionBus(MemoryBus(joins=one)) as bus:
        seen = []
        bus.watch(alive_key("*", "*"), lambda key, alive: seen.append(key))
        bus.subscribe(FEATURES.everywhere, lambda sample: None)
        for n in range(50):
            one.announce(f"slowtime/v1/lab/beam-{n}/alive")
            one.publish(f"slowtime/v1/lab/fan-{n}/features", b"", encoding="")
        assert len(bus.former) == 10
        assert len(seen) == 50
