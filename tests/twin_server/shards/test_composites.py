"""Composites whose twins are of several shards: answered as by a single server."""

import contextlib
import threading
import time
from typing import Any

import httpx
import pytest
import uvicorn

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.shards import Share
from twin_server.__main__ import run
from twin_server.shards.front import create_front
from twin_server.shards.process import settings_of

COUNT, READINGS = 2, 40
BEAMS = [f"beam-{number}" for number in range(4)]
IDS = [f"lab.{name}" for name in BEAMS]
LINE: dict[str, Any] = {
    "kind": "line",
    "members": IDS[:3],
    "tree": {"k": 2, "of": IDS[:3]},
    "failing": {IDS[0]: {"quantity": "stiffness_change", "at": -0.3}},
}
YARD: dict[str, Any] = {
    "name": "Yard",
    "members": ["lab.line", IDS[3]],
    "tree": {"parallel": ["lab.line", IDS[3]]},
    "dependence": [{"members": [IDS[0], IDS[3]], "beta": 0.2}],
}
ALONE: dict[str, Any] = {"members": [IDS[1]]}
COMPOSITES = {"lab.line": LINE, "lab.yard": YARD, "lab.alone": ALONE}


class Fleet:
    """Servers of one process on one bus, one for each shard, that can be ended."""

    count = COUNT

    def __init__(self, settings, folder, bus):
        shards = settings.shards.model_copy(update={"count": COUNT, "key": "of-the-test"})
        self.settings = settings.model_copy(
            update={"database": folder / "twin.sqlite", "shards": shards}
        )
        self.bus, self.urls, self.stops, self.threads = bus, {}, {}, {}

    def start(self, index):
        stop = self.stops[index] = threading.Event()
        here = {"bus": self.bus, "stop": stop, "ready": lambda url: self.told(index, url)}
        own = settings_of(self.settings, index)
        thread = self.threads[index] = threading.Thread(target=run, args=(own,), kwargs=here)
        thread.start()
        while index not in self.urls:
            assert thread.is_alive()
            time.sleep(0.01)

    def told(self, index, url):
        self.urls[index] = url

    def end(self, index):
        self.urls.pop(index, None)
        self.stops[index].set()
        self.threads[index].join(60)

    def url(self, index):
        return self.urls.get(index)


@contextlib.contextmanager
def served(app):
    """Serve an application; give a client of it."""
    config = uvicorn.Config(app, port=0, log_config=None, lifespan="off")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=300) as client:
        yield client
    server.should_exit = True
    thread.join()


@contextlib.contextmanager
def one_server(settings, folder, bus):
    stop, urls = threading.Event(), list[str]()
    own = settings.model_copy(update={"database": folder / "twin.sqlite"})
    here = {"bus": bus, "stop": stop, "ready": urls.append}
    thread = threading.Thread(target=run, args=(own,), kwargs=here)
    thread.start()
    while not urls:
        assert thread.is_alive()
        time.sleep(0.01)
    with httpx.Client(base_url=urls[0], timeout=300) as client:
        yield client
    stop.set()
    thread.join(60)


@pytest.fixture(scope="module")
def both(tmp_path_factory, settings):
    """A single server, and a fleet of two shards on another bus; their clients and buses."""
    folders = [tmp_path_factory.mktemp(name) for name in ("one", "two")]
    with MemoryBus() as alone, MemoryBus() as shared, contextlib.ExitStack() as stack:
        fleet = Fleet(settings, folders[1], shared)
        for index in range(COUNT):
            fleet.start(index)
            stack.callback(fleet.end, index)
        one = stack.enter_context(one_server(settings, folders[0], alone))
        front = stack.enter_context(served(create_front(fleet, fleet.settings)))
        for client in (one, front):
            for twin in IDS:
                body = {
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.2}]},
                }
                assert client.put(f"/api/v1/twins/{twin}", json=body).status_code == 201
        assert 0 < sum(Share(0, COUNT).has(beam) for beam in BEAMS) < len(BEAMS)
        yield one, front, alone, shared, fleet


def equal(one, front, path, **parameters):
    """Compare the answers to one question; return the status and the answer."""
    found, wanted = (client.get(path, params=parameters) for client in (front, one))
    assert found.status_code == wanted.status_code, found.text
    assert found.json() == wanted.json()
    return found.json()


def same_refusal(one, front, method, path, body=None):
    found, wanted = (client.request(method, path, json=body) for client in (front, one))
    assert found.status_code == wanted.status_code >= 400
    assert found.json() == wanted.json()
    return found.json()["detail"]


@pytest.fixture
def registered(both):
    """The composites, registered at both."""
    one, front, *_ = both
    for client in (one, front):
        for name, body in COMPOSITES.items():
            assert client.put(f"/api/v1/composites/{name}", json=body).status_code in (200, 201)
    return both


def test_composites_are_registered_listed_and_deleted_as_by_one_server(registered):
    one, front, *_ = registered
    told = equal(one, front, "/api/v1/composites")
    assert [each["id"] for each in told["composites"]] == list(COMPOSITES)
    for name in COMPOSITES:
        told = equal(one, front, f"/api/v1/composites/{name}")
        assert told["failure"]["reasons"]
        equal(one, front, f"/api/v1/composites/{name}/members")
    for twin in IDS:
        told = equal(one, front, f"/api/v1/twins/{twin}/memberships")
        assert "lab.yard" in told["above"]
    for client in (one, front):
        assert client.delete("/api/v1/composites/lab.alone").status_code == 204
    bodies = [
        [
            each["registration"]
            for each in client.get("/api/v1/composites/lab.yard/revisions").json()["revisions"]
        ]
        for client in (one, front)
    ]
    assert bodies[0] == bodies[1]
    assert len(bodies[0]) == 1
    assert len(equal(one, front, "/api/v1/composites")["composites"]) == len(COMPOSITES) - 1


def test_what_a_composite_cannot_be_is_refused_with_the_same_words(registered):
    one, front, *_ = registered
    cycle = {"members": ["lab.yard"]}
    said = same_refusal(one, front, "PUT", "/api/v1/composites/lab.line", cycle)
    assert "lab.yard → lab.line" in said
    unknown = {"members": ["lab.nobody"]}
    said = same_refusal(one, front, "PUT", "/api/v1/composites/lab.new", unknown)
    assert "neither a twin nor a composite" in said
    twin = {"members": [IDS[1]]}
    for taken in IDS:  # of either shard
        said = same_refusal(one, front, "PUT", f"/api/v1/composites/{taken}", twin)
        assert "is a twin already" in said
    # The shard of the id, which keeps no composites, would take it for free.
    assert any(Share(1, COUNT).has(name.partition(".")[2]) for name in COMPOSITES)
    for taken in COMPOSITES:
        said = same_refusal(one, front, "PUT", f"/api/v1/twins/{taken}", {})
        assert "is a composite" in said
    same_refusal(one, front, "DELETE", "/api/v1/composites/lab.line")
    same_refusal(one, front, "GET", "/api/v1/composites/lab.nobody")
    same_refusal(one, front, "PUT", "/api/v1/composites/lab.new", {"members": []})


def test_the_graph_of_all_sites_has_the_twins_of_all_shards(registered):
    one, front, *_ = registered
    graphs = [client.get("/api/v1/dtdl").json()["digitalTwinsGraph"] for client in (one, front)]
    for part, name in (("digitalTwins", "$dtId"), ("relationships", "$relationshipId")):
        wanted, found = ({each[name]: each for each in graph[part]} for graph in graphs)
        assert found == wanted
    assert {*IDS, *COMPOSITES, "lab"} <= {t["$dtId"] for t in graphs[1]["digitalTwins"]}
    assert equal(one, front, "/api/v1/dtdl", site="elsewhere")["digitalTwinsModels"]
    # A composite of this twin alone belongs to its graph.
    told = equal(one, front, f"/api/v1/twins/{IDS[1]}/dtdl")
    assert "lab.alone" in {t["$dtId"] for t in told["digitalTwinsGraph"]["digitalTwins"]}
    found = front.get("/api/v1/twins/lab.nobody/dtdl")
    assert (found.status_code, found.json()["title"]) == (404, "No such twin")


def test_the_port_of_a_shard_answers_its_front_only(both):
    *_, fleet = both
    for path in ("/api/v1/twins", "/shard/composites", "/healthz"):
        for given in ({}, {"x-slowtime-shard-key": "guessed"}):
            found = httpx.get(fleet.url(0) + path, headers=given)
            assert found.status_code == 403
            assert "answers the front of its fleet only" in found.json()["detail"]


def test_forecasts_and_rates_of_a_composite_are_those_of_one_server(
    registered, ageing, eventually
):
    one, front, alone, shared, _ = registered
    for number, name in enumerate(BEAMS):
        messages = ageing(READINGS, loss=0.1 + 0.03 * number, sd=0.01, seed=number, asset=name)
        for bus in (alone, shared):
            for message in messages:
                key = FEATURES.key(message.site, message.asset)
                bus.publish(key, encode(message), encoding=FEATURES.encoding, replayed=True)

    def digests(client):
        paths = (f"/api/v1/twins/{twin}/history/hash" for twin in IDS)
        return [client.get(path).json() for path in paths]

    assert eventually(lambda: [d["features"] for d in digests(front)] == [READINGS] * len(IDS))
    assert eventually(lambda: digests(one) == digests(front))
    for name in COMPOSITES:
        told = equal(one, front, f"/api/v1/composites/{name}")
        assert told["failure"]["value"] is not None
        sooner = equal(one, front, f"/api/v1/composites/{name}", horizon=5.0)
        assert sooner["failure"]["value"] <= told["failure"]["value"]
        if name == "lab.line":
            assert [each["id"] for each in told["pooled"][0]["members"]] == IDS[:3]


def test_a_composite_of_a_dead_shard_is_refused_with_its_name(registered):
    one, front, _, _, fleet = registered
    of_one = next(twin for twin in IDS if Share(1, COUNT).has(twin.partition(".")[2]))
    of_zero = next(twin for twin in IDS if Share(0, COUNT).has(twin.partition(".")[2]))
    body = {"members": [of_zero]}
    assert front.put("/api/v1/composites/lab.near", json=body).status_code == 201
    fleet.end(1)
    found = front.get("/api/v1/composites/lab.yard")
    assert found.status_code == 503
    assert found.headers["retry-after"] == "2"
    assert "Shard 1 of 2 does not answer" in found.json()["detail"]
    assert front.get("/api/v1/composites/lab.near").status_code == 200
    for path in ("/api/v1/dtdl", f"/api/v1/twins/{of_one}/memberships"):
        assert front.get(path).status_code == 503
    fleet.start(1)
    equal(one, front, "/api/v1/composites/lab.yard")
    fleet.end(0)
    assert front.get("/api/v1/composites/lab.near").status_code == 503
    fleet.start(0)
    assert front.get("/api/v1/composites/lab.near").status_code == 200
