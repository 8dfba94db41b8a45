"""The front of a fleet of shards, before shards that only tell who they are."""

import http.server
import json
import threading
import time

import httpx
import pytest
import uvicorn

from slowtime_services.shards import Share
from twin_server.settings import TwinSettings
from twin_server.shards.front import create_front

METRICS = """# HELP slowtime_twin_twins Registered twins.
# TYPE slowtime_twin_twins gauge
slowtime_twin_twins {index}
# HELP slowtime_twin_refused_total Messages that were refused, by reason.
# TYPE slowtime_twin_refused_total counter
slowtime_twin_refused_total{{reason="size"}} 0
"""


KEY = "of-this-start"


def plan_of(index):
    asset = {
        "id": f"lab.a{index}", "action": "wait", "sentence": "", "inspection": "ultrasound",
        "at": {"ahead": 0.0}, "net": 100.0 * (index + 1), "cost": 10.0, "visit": True,
    }  # fmt: skip
    return {
        "window_d": 30.0, "visits": 1, "budget": None, "currency": "EUR", "sentence": "",
        "assets": [asset], "without": [],
    }  # fmt: skip


class Shard:
    """An HTTP server that says what it was asked."""

    def __init__(self, index):
        self.index, self.goes_on = index, threading.Event()
        self.notes: list[str] = []
        self.asked: list[tuple[str, str, dict[str, str]]] = []
        shard = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                if self.path.endswith("/live"):
                    self.answer_in_parts()
                else:
                    self.answer(b"")

            def answer_in_parts(self):
                """Send one part, wait, and end before the second was sent."""
                self.send_response(200)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Transfer-Encoding", "chunked")
                self.end_headers()
                self.wfile.write(b"e\r\nevent: state\n\n\r\n")
                shard.goes_on.wait(30)

            def do_PUT(self):
                self.answer(self.rfile.read(int(self.headers["Content-Length"])))

            def answer(self, body):
                shard.asked.append((self.command, self.path, dict(self.headers.items())))
                said = shard.says(self.path, body)
                self.send_response(200)
                self.send_header("Content-Length", str(len(said)))
                self.send_header("X-Shard", str(shard.index))
                self.end_headers()
                self.wfile.write(said)

            protocol_version = "HTTP/1.1"

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.01,))
        self.thread.start()

    def says(self, path, body):
        if path == "/api/v1/twins":
            twins = [{"id": f"lab.{name}{self.index}"} for name in "ba"]
            return json.dumps({"twins": twins}).encode()
        if path.startswith("/api/v1/fleet/plan"):
            return json.dumps(plan_of(self.index)).encode()
        if path == "/readyz":
            return json.dumps({"status": "ok", "notes": self.notes}).encode()
        if path == "/metrics":
            return METRICS.format(index=self.index).encode()
        return json.dumps({"shard": self.index, "body": body.decode()}).encode()

    def close(self):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


class Fleet:
    """Three shards, some of which may be down."""

    count = 3

    def __init__(self):
        self.shards = [Shard(index) for index in range(self.count)]
        self.down = set()

    def url(self, index):
        return None if index in self.down else self.shards[index].url


@pytest.fixture
def fleet():
    made = Fleet()
    yield made
    for shard in made.shards:
        if shard.thread.is_alive():
            shard.close()


@pytest.fixture
def front(fleet):
    app = create_front(fleet, TwinSettings(shards={"count": 3, "key": KEY}))
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None, lifespan="off"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
        yield client
    server.should_exit = True
    thread.join()


def owner(asset):
    return next(index for index in range(3) if Share(index, 3).has(asset))


ASSETS = [f"mast-{number}" for number in range(20)]


def test_requests_about_a_twin_reach_its_shard(front):
    for asset in ASSETS:
        found = front.get(f"/api/v1/twins/lab.{asset}/history?max_points=5")
        assert found.json()["shard"] == owner(asset)
        assert found.headers["x-shard"] == str(owner(asset))


def test_query_body_and_token_arrive_and_the_origin_does_not(front, fleet):
    headers = {
        "Authorization": "Bearer abc",
        "Origin": "http://127.0.0.1",
        "X-Slowtime-Shard-Key": "guessed",
    }
    path = "/api/v1/twins/lab.mast-1/gap?a=b%20c"
    told = front.put(path, content=b"x" * 1000, headers=headers)
    assert told.json()["body"] == "x" * 1000
    ((method, there, given),) = fleet.shards[owner("mast-1")].asked
    assert (method, there) == ("PUT", path)
    given = {name.lower(): value for name, value in given.items()}
    assert given["authorization"] == "Bearer abc"
    assert "origin" not in given
    assert given["x-slowtime-shard-key"] == KEY


def test_a_live_stream_arrives_as_it_is_sent_and_ends_with_its_shard(front, fleet):
    with front.stream("GET", "/api/v1/twins/lab.mast-1/live") as answer:
        parts = answer.iter_raw()
        assert next(parts) == b"event: state\n\n"
        fleet.shards[owner("mast-1")].goes_on.set()
        assert list(parts) == []


def test_the_fleet_is_one_list_and_one_ranking(front):
    twins = [twin["id"] for twin in front.get("/api/v1/twins").json()["twins"]]
    assert twins == ["lab.a0", "lab.a1", "lab.a2", "lab.b0", "lab.b1", "lab.b2"]
    plan = front.get("/api/v1/fleet/plan").json()
    assert [asset["id"] for asset in plan["assets"]] == ["lab.a2", "lab.a1", "lab.a0"]
    assert [asset["visit"] for asset in plan["assets"]] == [True, False, False]
    assert "lab.a2" in plan["sentence"]


def test_metrics_name_the_shard_and_each_family_once(front, fleet):
    fleet.down.add(1)
    lines = front.get("/metrics").text.splitlines()
    assert 'slowtime_twin_shard_up{shard="1"} 0' in lines
    assert 'slowtime_twin_twins{shard="2"} 2' in lines
    assert 'slowtime_twin_refused_total{shard="0",reason="size"} 0' in lines
    assert lines.count("# TYPE slowtime_twin_twins gauge") == 1


@pytest.mark.parametrize("how", ["known", "found"])
def test_a_dead_shard_is_named_and_the_others_answer(front, fleet, how):
    if how == "known":
        fleet.down.add(1)
    else:
        fleet.shards[1].close()
    assert {owner(asset) for asset in ASSETS} == {0, 1, 2}
    for asset in ASSETS:
        found = front.get(f"/api/v1/twins/lab.{asset}")
        if owner(asset) != 1:
            assert found.json()["shard"] == owner(asset)
            continue
        assert found.status_code == 503
        assert found.headers["retry-after"] == "2"
        assert found.json()["type"] == "urn:slowtime:problem:shard-down"
        assert "Shard 1 of 3 does not answer" in found.json()["detail"]
        assert f"lab.{asset}" in found.json()["detail"]
    for path in ("/api/v1/twins", "/readyz"):
        found = front.get(path)
        assert found.status_code == 503
        assert "Shard 1 of 3 does not answer" in found.json()["detail"]
    assert front.get("/healthz").status_code == 200
    assert front.get("/").status_code == 200


def test_what_fails_in_a_shard_that_is_ready_is_named(front, fleet):
    assert front.get("/readyz").json() == {"status": "ok"}
    fleet.shards[2].notes.append("The ledger is not signed any more.")
    answer = front.get("/readyz")
    assert answer.status_code == 200
    assert answer.json() == {
        "status": "degraded",
        "notes": ["Shard 2: The ledger is not signed any more."],
    }


@pytest.mark.parametrize("what", ["consistency?first=3", "inclusion?boot=b&sequence=1"])
def test_proofs_of_a_chain_come_from_the_shard_of_its_twin(front, what):
    for asset in ASSETS:
        answer = front.get(f"/api/v1/ledger/chains/lab.{asset}/{what}")
        assert answer.json()["shard"] == owner(asset)


def test_signed_heads_are_those_of_the_shard_named(front):
    assert front.get("/api/v1/ledger/heads?shard=2").json()["shard"] == 2
    for given in ("", "?shard=3", "?shard=-1", "?shard=x"):
        found = front.get(f"/api/v1/ledger/heads{given}")
        assert found.status_code == 422
        assert "Allowed: 0 to 2" in found.json()["detail"]
