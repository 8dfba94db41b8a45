"""Twins as OPC UA objects, read by the client of another library (python-opcua)."""

import datetime
import time

import pytest

from slowtime_schemas.streams import alive_key
from tests.twin_server.serve.outputs.conftest import beam_of, free_port, processes

NAMESPACE = "urn:slowtime:twins"


@pytest.fixture(scope="module")
def beam(serving, ageing, eventually):
    return beam_of(serving, ageing, eventually)


@pytest.fixture(scope="module")
def plant(beam, tmp_path_factory):
    """Port of an OPC UA server of the twin of a server."""
    pytest.importorskip("asyncua")
    port = free_port()
    with processes(tmp_path_factory.mktemp("positions")) as start:
        start(beam.url, plant={"kind": "opcua", "port": port, "every_s": 0.2})
        yield port


@pytest.fixture(scope="module")
def client(plant, eventually):
    opcua = pytest.importorskip("opcua")
    made = opcua.Client(f"opc.tcp://127.0.0.1:{plant}/slowtime/", timeout=20)

    def connect():
        try:
            made.connect()
        except OSError:
            return False
        return True

    # Loading the standard's own nodes takes seconds of a core.
    deadline = time.monotonic() + 180
    while not connect():
        assert time.monotonic() < deadline
        time.sleep(0.5)
    assert eventually(lambda: read(made, "lab.beam/frequency_hz").Value is not None)
    yield made
    made.disconnect()


def node(client, name):
    index = client.get_namespace_index(NAMESPACE)
    return client.get_node(f"ns={index};s={name}")


def read(client, name):
    """Value, quality and stamps of a node, of whatever quality."""
    from opcua import ua

    wanted = ua.ReadValueId()
    wanted.NodeId, wanted.AttributeId = node(client, name).nodeid, ua.AttributeIds.Value
    asked = ua.ReadParameters()
    asked.NodesToRead.append(wanted)
    return client.uaclient.read(asked)[0]


def last(server):
    return server.get("/api/v1/twins/lab.beam/history").json()["points"][-1]


def test_a_twin_is_an_object_with_values_units_and_quality(beam, grow, client, eventually):
    index = client.get_namespace_index(NAMESPACE)
    path = [f"{index}:slowtime", f"{index}:lab", f"{index}:lab.beam", f"{index}:frequency_hz"]
    frequency = client.get_objects_node().get_child(path)
    name, wanted = "lab.beam/frequency_hz", last(beam)
    assert frequency.nodeid.Identifier == name
    told = read(client, name)
    assert told.Value.Value == wanted["frequency_hz"]["value"]
    since_1970 = told.SourceTimestamp.replace(tzinfo=datetime.UTC).timestamp()
    assert since_1970 == pytest.approx(wanted["t_ns"] / 1e9, abs=1e-5)
    # No agent is online, so the value is the last usable one.
    assert told.StatusCode.name == "UncertainLastUsableValue"
    parts = {one.get_browse_name().Name: one.nodeid for one in frequency.get_properties()}
    assert read(client, f"{name}/StandardDeviation").Value.Value == wanted["frequency_hz"]["sd"]
    limits = client.get_node(parts["EURange"]).get_value()
    assert (limits.Low, limits.High) == (0.0, 1000.0)
    unit = client.get_node(parts["EngineeringUnits"]).get_value()
    assert unit.DisplayName.Text == "Hz"
    assert unit.UnitId.to_bytes(3, "big") == b"HTZ"  # of UNECE (Part 8, 5.6.3)
    agent = beam.bus.announce(alive_key("lab", "beam"))
    grow(beam, 40)
    assert eventually(lambda: read(client, name).Value.Value == last_frequency(beam))
    assert eventually(lambda: read(client, name).StatusCode.name == "Good")
    agent.close()


def last_frequency(server):
    return last(server)["frequency_hz"]["value"]


def test_nobody_may_write(client):
    from opcua import ua

    with pytest.raises(ua.UaError):
        node(client, "lab.beam/frequency_hz").set_value(1.0)


@pytest.mark.gate
def test_alarms_are_events(beam, grow, client, eventually):
    heard = []

    class Handler:
        def event_notification(self, event):
            heard.append(event)

    index = client.get_namespace_index(NAMESPACE)
    kind = client.get_root_node().get_child(
        ["0:Types", "0:EventTypes", "0:BaseEventType", f"{index}:SlowtimeEventType"]
    )
    subscription = client.create_subscription(100, Handler())
    subscription.subscribe_events(evtypes=kind)
    body = {
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
        "alarms": [{"quantity": "stiffness_change", "below": -0.01}],
    }
    assert beam.client.put("/api/v1/twins/lab.beam", json=body).status_code == 200
    grow(beam, 60)
    assert eventually(lambda: any(one.Kind == "alarm" for one in list(heard)))
    alarm = next(one for one in heard if one.Kind == "alarm")
    told = next(
        one
        for one in beam.get("/api/v1/twins/lab.beam/events", after=0).json()["events"]
        if one["event_id"] == alarm.SlowtimeEventId
    )
    assert alarm.Message.Text == told["message"]
    assert (alarm.Severity, alarm.SourceName) == (900, "lab.beam")
    assert eventually(lambda: read(client, "lab.beam/alarm_raised").Value.Value is True)
    subscription.delete()
