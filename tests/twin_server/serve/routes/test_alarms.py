"""Alarms over REST: listed, acknowledged by who may, tried, and routed to what is allowed."""

import time

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.client import AnswerError, Client
from tests.twin_server.notify.conftest import Hook
from twin_server.events.receivers import AlarmSettings

TWIN = "/api/v1/twins/lab.beam"
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "confirm_readings": 1,
    "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
    "alarm_routes": [{"receiver": "ops"}],
}  # fmt: skip


@pytest.fixture(scope="module")
def hook():
    """A receiver on this machine."""
    made = Hook()
    yield made
    made.close()


@pytest.fixture(scope="module")
def server(serving, hook, tmp_path_factory):
    """A server with a receiver of its own site, and one of another."""
    secret = tmp_path_factory.mktemp("secret") / "secret"
    secret.write_text("a secret that is long enough")
    told = {"kind": "webhook", "url": hook.url, "secret_file": secret}
    receivers = {"ops": told, "theirs": told | {"sites": ["plant"]}}
    started = serving(alarms=AlarmSettings(receivers=receivers))
    assert started.client.put(TWIN, json=BODY).status_code == 201
    return started


def hear(server, features, first, *frequencies):
    for n, frequency_hz in enumerate(frequencies, first):
        message = features(n, frequency_hz=frequency_hz, t_ns=time.time_ns(), time_base="live")
        server.bus.publish(
            FEATURES.key("lab", "beam"), encode(message), encoding=FEATURES.encoding
        )


def test_an_alarm_goes_out_is_listed_and_acknowledged(server, hook, features, eventually):
    hear(server, features, 0, 3.0, 2.0)
    assert eventually(lambda: len(hook.told) == 1)
    client = Client(server.url)
    (alarm,) = client.alarms("lab.beam")
    assert alarm["event_id"] == hook.told[0]["event_id"]
    assert alarm["raised"] is True
    (event,) = [e for e in client.events("lab.beam") if e.kind == "alarm"]
    assert event.event_id == alarm["event_id"]
    assert client.acknowledge("lab.beam", alarm["event_id"], note="Seen.")["note"] == "Seen."
    with pytest.raises(AnswerError, match="already acknowledged by a local user"):
        client.acknowledge("lab.beam", alarm["event_id"])
    with pytest.raises(AnswerError, match="is none of the alarms"):
        client.acknowledge("lab.beam", "0" * 32)
    assert client.test_alarm("lab.beam")["receivers"] == ["ops"]
    with pytest.raises(AnswerError, match=r"lab\.beam is routed to: ops"):
        client.test_alarm("lab.beam", "theirs")

    def delivered():
        (route,) = client.deliveries("lab.beam")["routes"]
        return route["delivered"] == 2

    assert eventually(delivered)
    metrics = server.get("/metrics").text
    assert 'slowtime_twin_deliveries{receiver="ops",state="delivered"} 2' in metrics


@pytest.mark.parametrize(
    ("route", "says"),
    [
        ({"receiver": "nobody"}, "a route to nobody was given. Allowed for twins of lab: ops."),
        ({"receiver": "theirs"}, "Allowed for twins of lab: ops."),
        ({"receiver": "ops", "url": "http://169.254.169.254/"}, "url"),
        ({"receiver": "ops", "secret_file": "/etc/passwd"}, "secret_file"),
        ({"receiver": "../ops"}, "pattern"),
        ({"receiver": "http://127.0.0.1/"}, "pattern"),
    ],
)
def test_a_request_names_receivers_of_its_site_and_nothing_else(server, route, says):
    answer = server.client.put(TWIN, json=BODY | {"alarm_routes": [route]})
    assert answer.status_code == 422
    assert says in answer.text
    assert server.get(TWIN).json()["registration"]["alarm_routes"][0]["receiver"] == "ops"


def test_no_receiver_is_named_twice(server):
    twice = BODY | {"alarm_routes": [{"receiver": "ops"}] * 2}
    answer = server.client.put(TWIN, json=twice)
    assert answer.status_code == 422
    assert "Name each receiver once" in answer.text


def test_nothing_that_is_answered_holds_the_address_or_the_secret(server):
    for path in (TWIN, f"{TWIN}/alarms", f"{TWIN}/alarms/deliveries", "/metrics"):
        text = server.get(path).text
        assert "of-the-address" not in text
        assert "long enough" not in text
