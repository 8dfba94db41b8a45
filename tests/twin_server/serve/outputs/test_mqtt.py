"""Plain JSON and the discovery of Home Assistant, at Mosquitto as it is packaged."""

import json
import signal
import time

import pytest

STATE, EVENT, STATUS = (f"slowtime/lab/beam/{one}" for one in ("state", "event", "status"))
QUICK = {"host": "127.0.0.1", "every_s": 0.2, "backoff_s": 0.2, "max_backoff_s": 1.0}


def plain(port, **more):
    return {"kind": "mqtt", "port": port, **QUICK, **more}


def sequences(reader):
    return [json.loads(one)["sequence"] for one in reader.of(STATE)]


@pytest.mark.gate
def test_nothing_is_missing_after_the_broker_was_killed(
    beam, grow, mosquitto, subscriber, sending, eventually
):
    broker = mosquitto()
    reader = subscriber(broker.port, "slowtime/#")
    end = sending(beam.url, plant=plain(broker.port, begin="first"))
    assert eventually(lambda: set(sequences(reader)) == set(range(30)))
    broker.kill()
    grow(beam, 40)
    broker.start()
    assert eventually(lambda: set(sequences(reader)) == set(range(40)))
    end()
    grow(beam, 50)
    sending(beam.url, plant=plain(broker.port))
    assert eventually(lambda: set(sequences(reader)) == set(range(50)))
    events = beam.get("/api/v1/twins/lab.beam/events", after=0).json()["events"]
    heard = {json.loads(one)["event_id"] for one in reader.of(EVENT)}
    assert heard == {one["event_id"] for one in events}


def test_a_session_that_was_away_gets_what_it_missed(
    beam, grow, mosquitto, subscriber, sending, eventually
):
    broker = mosquitto()
    first = subscriber(broker.port, STATE)
    sending(beam.url, plant=plain(broker.port))
    assert eventually(lambda: sequences(first) == [29])
    first.close()
    other = subscriber(broker.port, STATE, session="other")
    grow(beam, 40)
    assert eventually(lambda: 39 in sequences(other))
    time.sleep(1.0)  # until the broker has written its sessions
    broker.kill()
    broker.start()
    second = subscriber(broker.port, STATE)
    assert eventually(lambda: set(sequences(second)) >= set(range(30, 40)))


def test_a_state_tells_what_rest_tells(beam, mosquitto, subscriber, sending, eventually):
    broker = mosquitto()
    reader = subscriber(broker.port, "slowtime/#")
    sending(beam.url, plant=plain(broker.port))
    assert eventually(lambda: reader.of(STATUS) and reader.of(STATE))
    told = json.loads(reader.of(STATE)[0])
    last = beam.get("/api/v1/twins/lab.beam/history").json()["points"][-1]
    for name in ("t_ns", "sequence", "slow_time", "frequency_hz", "stiffness_change", "valid"):
        assert told[name] == last[name]
    assert json.loads(reader.of(STATUS)[0])["alive"] is False
    assert reader.of("slowtime/bridge/plant") == [b"online"]


def test_home_assistant_finds_sensors(beam, mosquitto, subscriber, sending, eventually):
    jinja2 = pytest.importorskip("jinja2")
    broker = mosquitto()
    end = sending(beam.url, plant=plain(broker.port, home_assistant="homeassistant"))
    # Configurations are retained: a client that comes later gets them, too.
    alarm = "homeassistant/binary_sensor/slowtime_lab_beam/alarm/config"
    time.sleep(2.0)
    reader = subscriber(broker.port, "homeassistant/#", "slowtime/#", session="", clean=True)
    assert eventually(lambda: reader.of(alarm))
    found = {
        one.topic: json.loads(one.payload)
        for one in reader.heard
        if one.topic.endswith("config")
    }
    sensors = {topic.split("/")[3]: told for topic, told in found.items()}
    assert sensors.keys() == {
        "frequency_hz", "damping_ratio", "stiffness_change", "mass_change", "alarm",
    }  # fmt: skip
    state = json.loads(reader.of(STATE)[-1])
    environment = jinja2.Environment()
    shown = {}
    for name, told in sensors.items():
        assert told["device"]["name"] == "Beam"
        if name == "alarm":
            continue
        assert told["state_topic"] == STATE
        assert told["state_class"] == "measurement"
        template = environment.from_string(told["value_template"])
        shown[name] = template.render(value_json=state), told["unit_of_measurement"]
    assert float(shown["frequency_hz"][0]) == state["frequency_hz"]["value"]
    assert shown["frequency_hz"][1] == "Hz"
    change = state["stiffness_change"]["value"]
    assert float(shown["stiffness_change"][0]) == pytest.approx(100 * change)
    assert shown["stiffness_change"][1] == "%"
    status = environment.from_string(found[alarm]["value_template"])
    assert status.render(value_json={"raised": [{"limit": -0.1}]}) == "ON"
    assert status.render(value_json=json.loads(reader.of(STATUS)[-1])) == "OFF"
    end()
    assert eventually(lambda: reader.of("slowtime/bridge/plant")[-1] == b"offline")


def test_a_broker_that_hangs_does_not_slow_the_server(
    beam, grow, mosquitto, subscriber, sending, eventually
):
    broker = mosquitto()
    reader = subscriber(broker.port, STATE)
    sending(beam.url, plant=plain(broker.port, timeout_s=1.0))
    assert eventually(lambda: sequences(reader) == [29])
    broker.signal(signal.SIGSTOP)
    began_s = time.monotonic()
    grow(beam, 60)
    assert beam.get("/readyz").status_code == 200
    assert time.monotonic() - began_s < 20
    broker.signal(signal.SIGCONT)
    assert eventually(lambda: set(sequences(reader)) == set(range(29, 60)))
