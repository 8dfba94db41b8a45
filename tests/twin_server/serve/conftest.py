"""A running server on loopback, with a bus to feed it."""

import dataclasses
import threading
from typing import Any

import httpx
import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from twin_server.__main__ import run


@dataclasses.dataclass
class Running:
    """A server, its bus and a client of it."""

    url: str
    bus: MemoryBus
    client: httpx.Client
    stop: threading.Event
    thread: threading.Thread
    result: list[Any]

    def feed(self, messages):
        for message in messages:
            key = FEATURES.key(message.site, message.asset)
            self.bus.publish(key, encode(message), encoding=FEATURES.encoding, replayed=True)

    def get(self, path, **parameters):
        return self.client.get(path, params=parameters)

    def count(self, twin_id="lab.beam"):
        return self.get(f"/api/v1/twins/{twin_id}/history/hash").json().get("features", 0)


@pytest.fixture(scope="module")
def serving(tmp_path_factory, settings):
    """Start servers, and end them."""
    running = []

    def start(database=None, **changes):
        path = database or tmp_path_factory.mktemp("server") / "twin.sqlite"
        own = settings.model_copy(update={"database": path, **changes})
        bus, stop, ready = MemoryBus(), threading.Event(), threading.Event()
        urls, result = [], []

        def told(url):
            urls.append(url)
            ready.set()

        def serve():
            result.append(run(own, bus=bus, stop=stop, ready=told))
            ready.set()

        thread = threading.Thread(target=serve)
        thread.start()
        assert ready.wait(20)
        client = httpx.Client(base_url=urls[0], timeout=10)
        server = Running(urls[0], bus, client, stop, thread, result)
        running.append(server)
        return server

    yield start
    for server in running:
        server.client.close()
        server.stop.set()
        server.thread.join(10)
        server.bus.close()


@pytest.fixture(scope="module")
def server(serving, ageing, eventually):
    """One server with a twin that has aged for 300 epochs, shared by tests that only look."""
    started = serving()
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "name": "Beam"}
    assert started.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    started.feed(ageing(300))
    assert eventually(lambda: started.count() == 300)
    return started
