import json

import pytest

from slowtime_schemas.partitions import partition_of
from slowtime_schemas.streams import (
    ACK,
    FEATURES,
    REGISTRATION,
    REQUESTS,
    STATE,
    STREAMS,
    address_of,
    alive_key,
    any_key,
    current_key,
    former_key,
    parse_key,
    request_key,
    server_key,
)
from slowtime_services.bus import MemoryBus, TwoVersionBus

FORMER = "slowtime/v1/lab/beam"
BEAM = ("lab", "beam")


@pytest.fixture
def buses():
    """The bus of a server, and that of an agent beside it."""
    first = MemoryBus()
    with TwoVersionBus(first) as server, MemoryBus(joins=first) as agent:
        yield server, agent


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_former_key_names_the_same_stream_and_asset(stream):
    key = stream.key(*BEAM)
    assert former_key(key) == f"{FORMER}/{stream.name}"
    assert current_key(f"{FORMER}/{stream.name}") == key
    assert parse_key(key) == parse_key(f"{FORMER}/{stream.name}") == (stream, *BEAM)


def test_tokens_and_requests_have_a_former_key_and_servers_the_same_one():
    keys = [alive_key(*BEAM), *(request_key(*BEAM, what) for what in REQUESTS)]
    assert [current_key(former_key(key) or "") for key in keys] == keys
    assert {address_of(key) for key in keys} == {BEAM}
    assert former_key(server_key("one")) is None
    assert former_key(any_key()) == "slowtime/v1/*/*/*"


def test_a_key_with_the_partition_of_another_asset_is_refused_with_the_right_one():
    wrong = (partition_of("beam") + 1) % 256
    with pytest.raises(ValueError, match=rf"names partition {wrong}\. Allowed for beam: 174"):
        parse_key(f"slowtime/v2/lab/features/{wrong}/beam")


def test_a_server_hears_agents_of_both_versions_on_present_keys(buses):
    server, agent = buses
    heard = []
    server.subscribe(FEATURES.everywhere, lambda sample: heard.append(sample))
    agent.publish(f"{FORMER}/features", b"old", encoding=FEATURES.encoding)
    assert server.former == {BEAM}
    agent.publish(FEATURES.key(*BEAM), b"new", encoding=FEATURES.encoding)
    assert [(one.key, one.payload) for one in heard] == [
        (FEATURES.key(*BEAM), b"old"),
        (FEATURES.key(*BEAM), b"new"),
    ]
    assert server.former == frozenset()


def test_a_subscription_to_one_partition_hears_former_keys_of_that_partition_alone(buses):
    server, agent = buses
    heard = []
    own = FEATURES.key("*", "*", partition=partition_of("beam"))
    server.subscribe(own, lambda sample: heard.append(sample.key))
    for asset in ("beam", "fan"):
        agent.publish(f"slowtime/v1/lab/{asset}/features", b"", encoding=FEATURES.encoding)
        agent.publish(FEATURES.key("lab", asset), b"", encoding=FEATURES.encoding)
    assert heard == [FEATURES.key(*BEAM)] * 2


def test_acknowledgements_go_to_the_key_that_the_agent_listens_to(buses):
    server, agent = buses
    heard = []
    server.subscribe(FEATURES.everywhere, lambda sample: None)
    agent.subscribe("slowtime/**", lambda sample: heard.append(sample.key))
    agent.publish(f"{FORMER}/features", b"", encoding=FEATURES.encoding)
    heard.clear()
    for asset in ("beam", "fan"):
        server.publish(ACK.key("lab", asset), b"", encoding=ACK.encoding)
        server.publish(STATE.key("lab", asset), b"", encoding=STATE.encoding)
    assert heard == [
        f"{FORMER}/ack",
        STATE.key(*BEAM),
        ACK.key("lab", "fan"),
        STATE.key("lab", "fan"),
    ]


@pytest.mark.parametrize("spoken", ["former", "present"])
def test_an_agent_of_either_version_is_asked_and_answers_under_present_keys(buses, spoken):
    server, agent = buses
    key = request_key(*BEAM, "account")
    own = key if spoken == "present" else former_key(key)
    agent.answer(own, lambda query: [(own, json.dumps(query.parameters).encode())])
    (answer,) = server.ask(key, {"boot": "b"})
    assert (answer.key, answer.payload) == (key, b'{"boot": "b"}')
    (answer,) = server.ask(request_key("*", "*", "account"), {"boot": "b"})
    assert answer.key == key


def test_a_former_recorder_is_answered_under_former_keys(buses):
    server, agent = buses
    asked = []

    def handler(query):
        asked.append(query.key)
        return [(REGISTRATION.key(*BEAM), b"told")]

    server.answer(request_key("*", "*", "registration"), handler)
    (answer,) = agent.ask(f"{FORMER}/request/registration")
    assert (answer.key, answer.payload) == (f"{FORMER}/registration", b"told")
    assert asked == [request_key(*BEAM, "registration")]


def test_an_agent_that_is_brought_up_to_date_does_not_go_away(buses):
    server, agent = buses
    seen = []
    server.watch(alive_key("*", "*"), lambda *change: seen.append(change))
    before = agent.announce(f"{FORMER}/alive")
    after = agent.announce(alive_key(*BEAM))
    assert seen == [(alive_key(*BEAM), True)]
    before.close()
    assert seen == [(alive_key(*BEAM), True)]
    after.close()
    assert seen == [(alive_key(*BEAM), True), (alive_key(*BEAM), False)]
