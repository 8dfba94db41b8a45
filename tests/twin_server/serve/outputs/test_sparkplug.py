"""An edge node by Sparkplug B at Mosquitto, read by the published definition."""

import json
import signal
import time

import pytest

from slowtime_schemas.streams import alive_key
from tests.twin_server.serve.outputs.test_mqtt import QUICK

NODE = "spBv1.0/plant/{}/bridge"
DEVICE = NODE + "/lab.beam"


def node(port, **more):
    return {
        "kind": "sparkplug", "port": port, "group": "plant", "node": "bridge", "begin": "first",
        **QUICK, **more,
    }  # fmt: skip


@pytest.fixture(scope="module")
def definition():
    return pytest.importorskip("esio_spb_builder.core.sparkplug_b_pb2")


@pytest.fixture
def decoded(definition):
    """Return (kind, device, payload) of all messages of Sparkplug, in order."""
    from google.protobuf.unknown_fields import UnknownFieldSet

    def decode(reader):
        found = []
        for message in list(reader.heard):
            _, _, kind, *rest = message.topic.split("/")
            if kind == "NCMD" or "STATE" in message.topic:
                continue
            payload = definition.Payload()
            payload.ParseFromString(message.payload)
            assert len(UnknownFieldSet(payload)) == 0
            found.append((kind, rest[1] if len(rest) > 1 else "", payload))
        return found

    return decode


def values(payload):
    return {
        one.name: None if one.is_null else getattr(one, one.WhichOneof("value"))
        for one in payload.metrics
    }


def frequencies(messages):
    """Stamp [ms] → frequency of the data of the device."""
    return {
        one.timestamp: one.double_value
        for kind, _, payload in messages
        if kind == "DDATA"
        for one in payload.metrics
        if one.name == "frequency_hz"
    }


def wanted(server):
    points = server.get("/api/v1/twins/lab.beam/history", max_points=1_000).json()["points"]
    return {one["t_ns"] // 10**6: one["frequency_hz"]["value"] for one in points}


def rebirth(definition):
    payload = definition.Payload(timestamp=time.time_ns() // 10**6)
    payload.metrics.add(name="Node Control/Rebirth", datatype=11, boolean_value=True)
    return payload.SerializeToString()


def test_births_come_before_data_and_sequences_count(
    beam, mosquitto, subscriber, sending, eventually, decoded
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)
    end = sending(beam.url, plant=node(broker.port))
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    end()
    assert eventually(lambda: decoded(reader)[-1][0] == "NDEATH")
    messages = decoded(reader)
    assert [kind for kind, _, _ in messages[:2]] == ["NBIRTH", "DBIRTH"]
    assert {device for kind, device, _ in messages if kind.startswith("D")} == {"lab.beam"}
    *living, (_, _, death) = messages
    assert [one.seq for _, _, one in living] == [n % 256 for n in range(len(living))]
    assert values(death) == {"bdSeq": values(messages[0][2])["bdSeq"]}
    assert not death.HasField("seq")
    birth = values(messages[1][2])
    for _, _, payload in messages[2:-1]:
        assert values(payload).keys() <= birth.keys()
    units = {
        one.name: dict(zip(one.properties.keys, one.properties.values, strict=True))
        for one in messages[1][2].metrics
    }
    assert units["frequency_hz"]["engUnit"].string_value == "Hz"
    last = [p for k, _, p in messages if k == "DDATA" and "frequency_hz" in values(p)]
    historical = [any(one.is_historical for one in p.metrics) for p in last]
    assert historical == [True] * 29 + [False]


def test_a_rebirth_is_told_when_it_is_asked_for(
    beam, mosquitto, subscriber, sending, eventually, decoded, definition
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)
    sending(beam.url, plant=node(broker.port))
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    before = len(decoded(reader))
    reader.publish(NODE.format("NCMD"), rebirth(definition))
    reader.publish(NODE.format("NCMD"), b"\xff\xff nonsense")
    assert eventually(lambda: len(decoded(reader)) >= before + 2)
    (first, _, node_birth), (second, _, device_birth) = decoded(reader)[before : before + 2]
    assert (first, second) == ("NBIRTH", "DBIRTH")
    assert (node_birth.seq, device_birth.seq) == (0, 1)
    assert values(node_birth)["bdSeq"] == values(decoded(reader)[0][2])["bdSeq"]
    last = beam.get("/api/v1/twins/lab.beam/history").json()["points"][-1]
    assert values(device_birth)["frequency_hz"] == last["frequency_hz"]["value"]
    assert values(device_birth)["frequency_hz/sd"] == last["frequency_hz"]["sd"]


@pytest.mark.gate
def test_nothing_is_missing_after_the_broker_was_killed(
    beam, grow, mosquitto, subscriber, sending, eventually, decoded
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)

    def host(is_online):
        told = json.dumps({"online": is_online, "timestamp": time.time_ns() // 10**6})
        reader.publish("spBv1.0/STATE/scada", told, qos=1, retain=True)

    sending(beam.url, plant=node(broker.port, primary_host="scada"))
    time.sleep(1.0)
    assert decoded(reader) == []  # the host is not there
    host(True)
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    broker.kill()
    grow(beam, 40)
    broker.start()
    assert eventually(reader.is_there)
    host(True)
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    sessions = [values(p)["bdSeq"] for kind, _, p in decoded(reader) if kind == "NBIRTH"]
    assert len(set(sessions)) == len(sessions) >= 2


def test_nothing_is_sent_without_the_primary_host(
    beam, grow, mosquitto, subscriber, sending, eventually, decoded
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)

    def host(is_online):
        told = json.dumps({"online": is_online, "timestamp": time.time_ns() // 10**6})
        reader.publish("spBv1.0/STATE/scada", told, qos=1, retain=True)

    host(True)
    sending(beam.url, plant=node(broker.port, primary_host="scada", timeout_s=2.0))
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    host(False)
    time.sleep(1.0)
    grow(beam, 45)
    time.sleep(1.0)
    assert len(frequencies(decoded(reader))) == 30
    host(True)
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))


def test_a_device_dies_with_its_agent_and_is_born_again(
    beam, grow, mosquitto, subscriber, sending, eventually, decoded
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)
    agent = beam.bus.announce(alive_key("lab", "beam"))
    sending(beam.url, plant=node(broker.port))
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    agent.close()
    assert eventually(lambda: [k for k, _, _ in decoded(reader)].count("DDEATH") == 1)
    beam.bus.announce(alive_key("lab", "beam"))
    assert eventually(lambda: [k for k, _, _ in decoded(reader)].count("DBIRTH") == 2)


def test_a_broker_that_hangs_does_not_slow_the_server(
    beam, grow, mosquitto, subscriber, sending, eventually, decoded
):
    broker = mosquitto()
    reader = subscriber(broker.port, "spBv1.0/#", clean=True)
    sending(beam.url, plant=node(broker.port, timeout_s=1.0))
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
    broker.signal(signal.SIGSTOP)
    began_s = time.monotonic()
    grow(beam, 60)
    assert beam.get("/readyz").status_code == 200
    assert time.monotonic() - began_s < 20
    broker.signal(signal.SIGCONT)
    assert eventually(lambda: frequencies(decoded(reader)) == wanted(beam))
