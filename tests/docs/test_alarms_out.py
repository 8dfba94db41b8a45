"""What docs/alarms_out.md says of settings, routes and the signature is so."""

import json
import re
import socket
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from slowtime_services.client import Client
from tests.twin_server.notify.conftest import SECRET
from tests.twin_server.notify.test_senders import message
from twin_server.events import deliveries
from twin_server.events.receivers import AlarmSettings, WebhookReceiver
from twin_server.notify import NotDeliveredError
from twin_server.notify.webhook import Webhook
from twin_server.registration.twin import Registration
from twin_server.serve.access import POLICY

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/alarms_out.md").read_text()


def block(language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.S)
    return found


def test_the_settings_and_the_registration_that_it_shows_are_valid():
    declared = AlarmSettings.model_validate(tomllib.loads(block("toml"))["alarms"])
    routed = Registration.model_validate_json(block("json"))
    assert {one.receiver for one in routed.alarm_routes} == set(declared.receivers)
    assert {one.kind for one in declared.receivers.values()} == {"webhook", "email", "mqtt"}


def test_every_setting_route_metric_and_state_that_it_names_is_one():
    named = set(re.findall(r"`alarms\.(\w+)", TEXT))
    assert named == set(AlarmSettings.model_fields) - {"receivers"}
    routes = {(rule.method, rule.path) for rule in POLICY}
    told = re.findall(r"`(GET|POST) (/api/[\w/{}]+)`", TEXT)
    assert {(m, p.replace("{id}", "{twin_id}")) for m, p in told} <= routes
    assert {(m, p) for m, p in routes if "/alarms" in p} <= {
        (m, p.replace("{id}", "{twin_id}")) for m, p in told
    }
    metrics = (ROOT / "twin_server/serve/metrics.py").read_text()
    for name in re.findall(r"`slowtime_twin_(\w+)", TEXT):
        assert f'"{name}"' in metrics
    for kind in ("ACKNOWLEDGED", "GIVEN_UP", "TEST"):
        assert f"`{getattr(deliveries, kind)}`" in TEXT
    for method in re.findall(r"`Client\.(\w+)`", TEXT):
        assert hasattr(Client, method)
    defaults = AlarmSettings()
    assert (defaults.max_reading_age_s, defaults.max_age_s) == (3_600.0, 86_400.0)
    assert (defaults.backoff_s, defaults.max_backoff_s) == (2.0, 300.0)


def test_every_field_of_a_message_is_named():
    table = TEXT.partition("## The message")[2].partition("### A receiver")[0]
    assert message().content.keys() <= set(re.findall(r"`(\w+)`", table))


@pytest.fixture
def receiver(tmp_path):
    """The receiver that the page shows, as a process: its port, and the process."""
    program, secret = tmp_path / "receiver.py", tmp_path / "secret"
    program.write_text(block("python"))
    secret.write_text(SECRET + "\n")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, str(program), str(secret), str(port)], stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        assert time.monotonic() < deadline
        time.sleep(0.05)
    yield port, process
    process.kill()
    process.communicate()


def test_the_receiver_acts_once_on_what_is_signed_and_refuses_the_rest(receiver, tmp_path):
    port, process = receiver
    other = tmp_path / "other"
    other.write_text("another secret that is long")

    def hook(secret, **more):
        url = f"http://127.0.0.1:{port}/"
        return Webhook(WebhookReceiver(kind="webhook", url=url, secret_file=secret), **more)

    right = hook(tmp_path / "secret")
    first, second = message("One."), message("Two.", reminder=1)
    right.send(first)
    right.send(first)
    with pytest.raises(NotDeliveredError, match="answered 401"):
        hook(other).send(second)
    with pytest.raises(NotDeliveredError, match="answered 401"):
        hook(tmp_path / "secret", now_s=lambda: time.time() - 3_600).send(second)
    right.send(second)
    process.terminate()
    said, _ = process.communicate(timeout=60)
    assert said.splitlines() == ["Wake somebody: One.", "Wake somebody: Two."]
    assert json.loads(first.payload)["id"] != json.loads(second.payload)["id"]
