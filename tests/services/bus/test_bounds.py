"""What other processes send is bounded: answers, messages of any size, addresses, agents."""

import time

import pytest

from slowtime_schemas.streams import FEATURES, alive_key
from slowtime_services.bus import (
    Inbox,
    MemoryBus,
    Sample,
    TwoVersionBus,
    ZenohBus,
    key_versions,
)
from slowtime_services.bus import zenoh as zenoh_bus
from slowtime_services.bus.keys import InvalidKeyError


def test_answers_without_end_are_read_up_to_a_bound_and_that_is_told(pair):
    def answer(query):
        for _ in range(1_000):
            yield "slowtime/test/a", b"x" * 488

    def asked():
        return pair.other.ask("slowtime/test/a", max_bytes=20_000)

    pair.one.answer("slowtime/test/a", answer)
    deadline, answers = time.monotonic() + 60, asked()
    while not answers and time.monotonic() < deadline:
        answers = asked()
    assert 0 < sum(len(one.payload) for one in answers) <= 20_000
    assert answers.errors == (
        "Answers of more than 20,000 bytes were given; the rest is left.",
    )
    assert len(asked()) == len(answers)  # and the bus goes on


def test_a_message_larger_than_any_stream_is_left_out_and_the_connection_stays(
    endpoint, monkeypatch, eventually
):
    with ZenohBus("client", [endpoint]) as sender:
        monkeypatch.setattr(zenoh_bus, "MOST_MESSAGE_BYTES", 100_000)
        with ZenohBus("client", [endpoint]) as receiver:
            inbox: Inbox[int] = Inbox()
            came: list[int] = []

            def hear(sample: Sample) -> None:
                inbox.put(len(sample.payload))

            def has_come(size: int) -> bool:
                came.extend(inbox.take())
                return size in came

            def reaches() -> bool:
                sender.publish("slowtime/test/large", b"1", encoding="")
                return has_come(1)

            receiver.subscribe("slowtime/test/large", hear)
            assert eventually(reaches)
            for size in (90_000, 1_000_000, 50_000):
                sender.publish("slowtime/test/large", bytes(size), encoding="")
            assert eventually(lambda: has_come(50_000))
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
