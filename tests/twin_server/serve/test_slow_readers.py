"""Subscribers that take next to nothing: the others are served as if they were not there."""

import signal
import socket
import subprocess
import sys
import threading
import time
from urllib.parse import urlsplit

import httpx
import pytest

from slowtime_services.bus import ZenohBus
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

COUNT = 1500


class OneByteASecond(threading.Thread):
    """A client of the live stream with a small buffer."""

    def __init__(self, url, over):
        super().__init__(daemon=True)
        parts = urlsplit(url)
        self._over, self.bytes, self.ended = over, 0, False
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        self._socket.connect((parts.hostname, parts.port))
        head = f"GET /api/v1/twins/lab.beam/live HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n"
        self._socket.sendall(head.encode())

    def run(self):
        while not self._over.wait(1.0):
            self.bytes += len(self._socket.recv(1))
        self._socket.close()


class Listening(threading.Thread):
    """A client that reads as it comes; keeps the number of states."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self._url, self.states = url, 0
        self.connected = threading.Event()

    def run(self):
        with httpx.stream("GET", self._url + "/api/v1/twins/lab.beam/live", timeout=60) as told:
            self.connected.set()
            for line in told.iter_lines():
                self.states += line == "event: state"
                if self.states >= COUNT:
                    return


@pytest.mark.long
def test_clients_that_read_one_byte_a_second_delay_nobody_and_cost_bounded_memory(
    serving, ageing, eventually, capsys
):
    server = serving()
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    assert server.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    over = threading.Event()
    slow = [OneByteASecond(server.url, over) for _ in range(5)]
    for one in slow:
        one.start()
    quick = Listening(server.url)
    quick.start()
    assert quick.connected.wait(60)
    messages, longest_s = ageing(COUNT), 0.0
    for first in range(0, COUNT, 50):
        server.feed(messages[first : first + 50])
        begun = time.monotonic()
        assert server.get("/api/v1/twins/lab.beam").status_code == 200
        longest_s = max(longest_s, time.monotonic() - begun)
    assert eventually(lambda: server.count() == COUNT)
    quick.join(60)
    over.set()
    with capsys.disabled():
        print(
            f"\nfive clients of one byte a second took {[one.bytes for one in slow]} bytes; "
            f"another took {quick.states} of {COUNT} states; REST at most {longest_s:.2f} s"
        )
    assert quick.states == COUNT


SUBSCRIBER = """
import sys, time
from slowtime_services.bus import ZenohBus
bus = ZenohBus("client", [sys.argv[1]])
handle = bus.subscribe("**", lambda sample: None)
print("ready", flush=True)
time.sleep(3600)
"""


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no SIGSTOP on this system")
def test_a_subscriber_that_is_stopped_delays_no_acknowledged_feature_for_long(
    tmp_path, features, edge, eventually, capsys
):
    endpoint = free_endpoint()
    store = SqliteStore(tmp_path / "twin.sqlite")
    settings = TwinSettings(healing={"grace_s": 0.2, "max_backoff_s": 1.0})
    with (
        ZenohBus("router", listen=[endpoint]),
        ZenohBus("client", [endpoint]) as of_twin,
        ZenohBus("client", [endpoint]) as of_edge,
    ):
        pipeline = Pipeline(settings, store, bus=of_twin)
        pipeline.start()
        stopped = subprocess.Popen(
            [sys.executable, "-c", SUBSCRIBER, endpoint], stdout=subprocess.PIPE
        )
        try:
            assert stopped.stdout is not None
            assert stopped.stdout.readline() == b"ready\n"
            stopped.send_signal(signal.SIGSTOP)
            beam = edge(of_edge)
            begun = time.monotonic()
            for number in range(COUNT):
                beam.make(features(number))
                time.sleep(0.005)
            sent_s = time.monotonic() - begun
            assert eventually(lambda: store.count("lab.beam") == COUNT)
            took_s = time.monotonic() - begun - sent_s
        finally:
            stopped.kill()
            stopped.communicate()
            beam.close()
            pipeline.stop()
            store.close()
    with capsys.disabled():
        print(
            f"\nbeside a stopped subscriber {COUNT} features were sent in {sent_s:.1f} s, and "
            f"stored {took_s:.1f} s after the last was sent"
        )
    assert took_s < 30.0
