"""Receivers as they are packaged, on this machine, that can be killed and started again."""

import contextlib
import shutil
import signal
import socket
import subprocess
import threading
import time
from typing import Any

import pytest

from slowtime_services.outputs import OutputsSettings, run


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class Program:
    """A program that listens on a port; `kill` ends it as a power cut would."""

    def __init__(self, command, port):
        self._command, self.port = command, port
        self._process: Any = None
        self.start()

    def start(self):
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + 60
        while True:
            with (
                contextlib.suppress(OSError),
                socket.create_connection(("127.0.0.1", self.port)),
            ):
                return
            assert self._process.poll() is None, f"{self._command[0]} has ended"
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def signal(self, number):
        self._process.send_signal(number)

    def kill(self):
        self._process.send_signal(signal.SIGKILL)
        self._process.wait(30)

    def close(self):
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGCONT)
            self._process.terminate()
            try:
                self._process.wait(20)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(20)


@pytest.fixture
def program():
    """Start programs, and end them."""
    with contextlib.ExitStack() as open_things:

        def start(name, package, command, port):
            path = shutil.which(name) or shutil.which(name, path="/usr/sbin")
            if path is None:
                pytest.skip(f"no {name}: apt install {package}")
            made = Program([path, *command], port)
            open_things.callback(made.close)
            return made

        yield start


@pytest.fixture
def mosquitto(program, tmp_path):
    """Start Mosquitto, which keeps sessions and retained messages on the disk at once."""

    def start():
        port, folder = free_port(), tmp_path / "mosquitto"
        folder.mkdir()
        settings = folder / "mosquitto.conf"
        settings.write_text(
            f"listener {port} 127.0.0.1\nallow_anonymous true\nuser root\n"
            f"persistence true\npersistence_location {folder}/\n"
            "autosave_on_changes true\nautosave_interval 1\nmax_queued_messages 0\n"
        )
        return program("mosquitto", "mosquitto", ["-c", str(settings)], port)

    return start


@contextlib.contextmanager
def processes(positions):
    """Start processes of outputs in threads; what `start` gives ends one."""
    with contextlib.ExitStack() as open_things:

        def start(url, **outputs):
            settings = OutputsSettings(server=url, folder=positions, outputs=outputs)
            stop, ready = threading.Event(), threading.Event()
            thread = threading.Thread(
                target=run, args=(settings,), kwargs={"stop": stop, "ready": ready.set}
            )
            thread.start()
            assert ready.wait(60)

            def end():
                stop.set()
                thread.join(60)
                assert not thread.is_alive()

            open_things.callback(end)
            return end

        yield start


@pytest.fixture
def sending(tmp_path):
    """Start the process of outputs; what it gives ends it."""
    with processes(tmp_path / "positions") as start:
        yield start


class Subscriber:
    """A client of a broker with a session that is kept; it connects again by itself."""

    def __init__(self, port, *topics, session="reader", clean=False):
        client_module = pytest.importorskip("paho.mqtt.client")
        self.heard: list[Any] = []
        self._there = threading.Event()
        client = self._client = client_module.Client(
            client_module.CallbackAPIVersion.VERSION2,
            client_id=session,
            protocol=client_module.MQTTv311,
            clean_session=clean,
        )
        client.reconnect_delay_set(1, 1)
        client.on_message = lambda _c, _u, message: self.heard.append(message)
        client.on_connect = lambda c, *_: c.subscribe([(topic, 1) for topic in topics])
        client.on_subscribe = lambda *_: self._there.set()
        client.connect("127.0.0.1", port)
        client.loop_start()
        assert self._there.wait(30)

    def of(self, topic):
        """Payloads of a topic, in order."""
        return [bytes(one.payload) for one in list(self.heard) if one.topic == topic]

    def is_there(self):
        """Whether it is connected."""
        return self._client.is_connected()

    def publish(self, topic, payload, **more):
        self._client.publish(topic, payload, **more).wait_for_publish(10)

    def close(self):
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def subscriber():
    """Make subscribers, and end them."""
    made = []

    def start(*args, **more):
        made.append(Subscriber(*args, **more))
        return made[-1]

    yield start
    for one in made:
        one.close()


@pytest.fixture
def beam(serving, ageing, eventually):
    """A server with a twin of thirty readings."""
    return beam_of(serving, ageing, eventually)


def beam_of(serving, ageing, eventually):
    server = serving()
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "name": "Beam"}
    assert server.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    server.feed(ageing(30))
    assert eventually(lambda: server.count() == 30)
    return server


@pytest.fixture
def grow(ageing, eventually):
    """Feed a server further readings of its twin, up to a count."""

    def more(server, count):
        present = server.count()
        server.feed(ageing(count - present, first=present))
        assert eventually(lambda: server.count() == count)

    return more
