"""A real broker: topics a channel, TLS, and a password that stands in a file."""

import datetime
import ipaddress
import json
import shutil
import socket
import subprocess
import threading
import time

import paho.mqtt.client as paho
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from paho.mqtt.enums import CallbackAPIVersion

from edge_agent.inputs import LiveInput
from edge_agent.layouts import Channel, CounterField, JsonLayout
from tests.edge_agent.acquire.live.listening import opened

pytestmark = pytest.mark.system
TOPICS = JsonLayout(
    channels=tuple(Channel(name=n, at="v", topic=f"rig/{n}") for n in "xy"),
    counter=CounterField(at="n"),
)


def certificate(folder):
    """Make a certificate of 127.0.0.1 that signs itself."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "broker")])
    now = datetime.datetime.now(datetime.UTC)
    address = x509.IPAddress(ipaddress.ip_address("127.0.0.1"))
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(hours=1))
        .add_extension(x509.SubjectAlternativeName([address]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    pem, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    (folder / "broker.pem").write_bytes(made.public_bytes(pem))
    form = serialization.PrivateFormat.PKCS8
    (folder / "broker.key").write_bytes(key.private_bytes(pem, form, plain))
    (folder / "broker.key").chmod(0o644)  # the broker gives up root before it reads it


@pytest.fixture
def broker(tmp_path):
    """Mosquitto with TLS and a password; its port."""
    programs = [
        shutil.which(name) or shutil.which(name, path="/usr/sbin")
        for name in ("mosquitto", "mosquitto_passwd")
    ]
    server, passwords = programs
    if server is None or passwords is None:
        pytest.skip("mosquitto is not installed: apt-get install mosquitto")
    certificate(tmp_path)
    subprocess.run(
        [passwords, "-b", "-c", str(tmp_path / "users"), "pi", "raspberry"], check=True
    )
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    (tmp_path / "users").chmod(0o644)
    (tmp_path / "broker.conf").write_text(
        f"listener {port} 127.0.0.1\nuser root\npassword_file {tmp_path}/users\n"
        f"certfile {tmp_path}/broker.pem\nkeyfile {tmp_path}/broker.key\n"
    )
    process = subprocess.Popen(
        [server, "-c", str(tmp_path / "broker.conf")], stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.05)
    yield port
    process.kill()
    process.wait()


def publish(port, folder, stop, sent):
    """Send the two axes of a board on topics of their own; one sample of one axis is lost."""
    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.username_pw_set("pi", "raspberry")
    client.tls_set(str(folder / "broker.pem"))
    client.connect("127.0.0.1", port)
    client.loop_start()
    n = 0
    while not stop.is_set():
        for axis, sign in (("x", 1), ("y", -1)):
            if (n, axis) != (40, "y"):
                client.publish(f"rig/{axis}", json.dumps({"n": n, "v": sign * n}))
        n += 1
        sent.append(n)
        time.sleep(0.01)
    client.disconnect()
    client.loop_stop()


def test_topics_meet_in_one_row_behind_tls_and_a_password(broker, tmp_path):
    (tmp_path / "password").write_text("raspberry\n")
    live = LiveInput(
        source=f"mqtts://pi@127.0.0.1:{broker}/", layout=TOPICS, rate_hz=100, block_s=0.1,
        ca_file=tmp_path / "broker.pem", password_file=tmp_path / "password",
    )  # fmt: skip
    stop, over, sent = threading.Event(), threading.Event(), list[int]()
    source = opened(live, stop)
    sender = threading.Thread(target=publish, args=(broker, tmp_path, over, sent))
    sender.start()
    timer = threading.Timer(90, stop.set)
    timer.start()
    taken, sent_before = 0, 0
    for block in source:
        sent_before = sent_before or len(sent)
        rows = block.samples
        whole = rows[abs(rows).max(axis=1) >= 0]
        assert (whole[:, 0] == -whole[:, 1]).all()
        taken += len(whole)
        if taken > 100:
            stop.set()
    timer.cancel()
    over.set()
    sender.join()
    assert taken > 100
    assert sent_before < 1000  # two topics at their rate are no backlog, which holds for 15 s
    assert source.counts()["samples_refused"] == 0


def test_who_has_the_wrong_password_is_told_and_goes_on_trying(broker, tmp_path, caplog):
    (tmp_path / "password").write_text("wrong\n")
    live = LiveInput(
        source=f"mqtts://pi@127.0.0.1:{broker}/rig/x?qos=0", layout=TOPICS, rate_hz=100,
        ca_file=tmp_path / "broker.pem", password_file=tmp_path / "password",
    )  # fmt: skip
    stop = threading.Event()
    source = opened(live, stop)
    reading = threading.Thread(target=lambda: list(source))
    reading.start()
    deadline = time.monotonic() + 60
    while source.counts()["sensor_reconnects"] < 2 and time.monotonic() < deadline:
        time.sleep(0.05)
    stop.set()
    reading.join()
    assert source.counts()["sensor_reconnects"] >= 2
    assert "The broker refuses: Not authorized" in caplog.text
