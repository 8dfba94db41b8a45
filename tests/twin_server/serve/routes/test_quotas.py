"""Two sites at one server: one takes all it can, and the other goes on."""

import contextlib
import datetime
import socket
import threading

import httpx
import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter
from twin_server.identity.tokens import TokenFile
from twin_server.settings import (
    AccessSettings,
    DiagnoseSettings,
    RecordingSettings,
    ServeSettings,
)

V1 = "/api/v1"
DAY = datetime.timedelta(days=1)
SECRET = "greedy-secret"
"""Name of the other site, which nothing may tell."""


def recording(path, messages, site, *, span_s=1.0):
    """Write features of a site as a recorder would; its bytes."""
    path.unlink(missing_ok=True)
    with RecordingWriter(path) as writer:
        for i, message in enumerate(messages):
            t_ns = message.t_ns + int(i * span_s * 1e9)
            told = encode(message.model_copy(update={"site": site}))
            writer.write(FEATURES, site, message.asset, told, t_ns)
    return path.read_bytes()


class Site:
    """The clients of one site, by scope."""

    def __init__(self, server, tokens, name):
        self.name, self.server = name, server
        self.words = {
            scope: tokens.add(f"{scope} of {name}", scope, [name], DAY)
            for scope in ("viewer", "operator", "admin")
        }

    def ask(self, method, path, scope="admin", **more):
        headers = {"Authorization": f"Bearer {self.words[scope]}"}
        return self.server.client.request(method, V1 + path, headers=headers, **more)

    def trickle(self, name):
        """Begin an upload of which a byte comes now and then; its connection."""
        address = httpx.URL(self.server.url)
        connection = socket.create_connection((address.host, address.port), timeout=60)
        connection.sendall(
            f"PUT {V1}/recordings/{name} HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            f"Authorization: Bearer {self.words['operator']}\r\n"
            "Content-Length: 9999\r\n\r\nx".encode()
        )
        return connection

    def holdings(self, kind, scope="viewer"):
        found = self.ask("GET", "/holdings", scope).json()["holdings"]
        return [one for one in found if one["kind"] == kind]


@pytest.fixture(scope="module")
def sites(serving, tmp_path_factory):
    """A greedy and a modest site."""
    home = tmp_path_factory.mktemp("quotas")
    tokens = TokenFile(home / "tokens.json")
    root = tokens.add("root", "admin", ["*"], DAY)
    server = serving(
        access=AccessSettings(tokens=tokens.path, burst=100_000),
        diagnose=DiagnoseSettings(recordings=home / "recordings"),
        recordings=RecordingSettings(
            patience_s=3.0, max_at_once=4, max_total_bytes=900_000, max_files=12
        ),
        serve=ServeSettings(max_live_clients=6),
    )
    greedy, modest = Site(server, tokens, SECRET), Site(server, tokens, "modest")
    greedy.words["root"] = root
    return greedy, modest


def test_uploads_that_trickle_hold_no_slot_and_leave_some_for_another_site(
    sites, ageing, tmp_path, eventually
):
    greedy, modest = sites
    trickling = [greedy.trickle(f"slow-{i}.mcap") for i in range(6)]
    stop = threading.Event()

    def drip():
        while not stop.wait(0.3):
            for connection in trickling:
                with contextlib.suppress(OSError):
                    connection.sendall(b"x")

    dripping = threading.Thread(target=drip)
    dripping.start()
    try:
        assert eventually(lambda: len(greedy.holdings("uploads")) == 2)
        refused = greedy.ask("PUT", "/recordings/more.mcap", content=b"x")
        assert refused.status_code == 429
        assert refused.headers["retry-after"] == "5"
        content = recording(tmp_path / "a.mcap", ageing(20), "modest")
        given = modest.ask("PUT", "/recordings/mine.mcap", content=content)
        assert given.status_code == 201
        assert modest.holdings("uploads") == []
        # A byte now and then does not keep them: they fall behind the slowest rate.
        assert eventually(lambda: not greedy.holdings("uploads"))
    finally:
        stop.set()
        dripping.join()
        for connection in trickling:
            connection.close()


def test_admins_see_and_end_what_holds_their_own_site_up(sites, eventually):
    greedy, modest = sites
    with greedy.trickle("held.mcap") as connection:
        assert eventually(lambda: greedy.holdings("uploads"))
        [one] = greedy.holdings("uploads")
        assert (one["what"], one["site"], one["cancellable"]) == (
            "upload of held.mcap", SECRET, True,
        )  # fmt: skip
        assert one["token"].startswith(f"operator of {SECRET}")
        path = f"/holdings/{one['id']}"
        elsewhere = modest.ask("DELETE", path)
        nothing = modest.ask("DELETE", f"/holdings/{'0' * 16}")
        assert elsewhere.status_code == nothing.status_code == 404
        assert elsewhere.text.replace(one["id"], "0" * 16) == nothing.text
        assert SECRET not in modest.ask("GET", "/holdings").text
        assert greedy.ask("DELETE", path, "operator").status_code == 403
        assert greedy.holdings("uploads") == [one]
        assert greedy.ask("DELETE", path).status_code == 200
        assert eventually(lambda: not greedy.holdings("uploads"))
        said = b""
        while part := connection.recv(4096):
            said += part
            if b"cancelled by an admin" in said:
                break
        assert said.startswith(b"HTTP/1.1 503")


def test_a_replay_that_would_take_weeks_is_refused(sites, ageing, tmp_path, eventually):
    greedy, modest = sites
    for site in sites:
        content = recording(tmp_path / "r.mcap", ageing(30, asset="played"), site.name)
        given = site.ask("PUT", "/recordings/slow.mcap", content=content)
        assert given.status_code == 201, given.text
    play = "/recordings/slow.mcap/replay"
    refused = greedy.ask("POST", play, json={"speed": 1e-6})
    assert (refused.status_code, refused.json()["type"][-8:]) == (422, "too-slow")
    assert "recordings.max_replay_s" in refused.json()["detail"]
    # One that takes hours holds up neither the other site nor, for good, its own.
    assert greedy.ask("POST", play, json={"speed": 0.01}).status_code == 202
    assert modest.ask("POST", play, json={}).status_code == 202
    assert eventually(
        lambda: (
            [
                one["replay"]["state"] == "done"
                for one in modest.ask("GET", "/recordings").json()["recordings"]
                if one["replay"]
            ]
            == [True]
        )
    )
    [held] = greedy.holdings("replays")
    assert greedy.ask("POST", play, json={}).status_code in (409, 429)
    assert greedy.ask("DELETE", f"/holdings/{held['id']}").status_code == 200
    assert eventually(lambda: not greedy.holdings("replays"))


def test_recordings_of_one_site_leave_room_for_another(sites, ageing, tmp_path):
    greedy, modest = sites
    content = recording(tmp_path / "a.mcap", ageing(5, asset="many"), SECRET)
    statuses = [
        greedy.ask("PUT", f"/recordings/many-{i}.mcap", content=content).status_code
        for i in range(10)
    ]
    assert 507 in statuses
    assert statuses.count(201) <= 6
    content = recording(tmp_path / "b.mcap", ageing(5, asset="few"), "modest")
    assert modest.ask("PUT", "/recordings/few.mcap", content=content).status_code == 201


def test_streams_that_nobody_reads_leave_some_for_another_site_and_are_counted(
    sites, eventually
):
    greedy, modest = sites
    for site in sites:
        twin = f"/twins/{site.name}.played"
        assert eventually(lambda twin=twin, site=site: site.ask("GET", twin).status_code == 200)
    address = httpx.URL(greedy.server.url)
    deaf = []
    for _ in range(8):
        connection = socket.create_connection((address.host, address.port), timeout=60)
        connection.sendall(
            f"GET {V1}/twins/{SECRET}.played/live HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            f"Authorization: Bearer {greedy.words['viewer']}\r\n\r\n".encode()
        )
        deaf.append(connection)
    try:
        assert eventually(lambda: len(greedy.holdings("streams")) == 3)
        own = {"Authorization": f"Bearer {modest.words['viewer']}"}
        live = f"{V1}/twins/modest.played/live"
        with modest.server.client.stream("GET", live, headers=own) as stream:
            assert stream.status_code == 200
            root = {"Authorization": f"Bearer {greedy.words['root']}"}
            metrics = greedy.server.client.get("/metrics", headers=root).text
            assert f'slowtime_twin_under_way{{kind="streams",site="{SECRET}"}} 3' in metrics
            assert 'slowtime_twin_under_way{kind="streams",site="modest"} 1' in metrics
            assert eventually(lambda: _refused(greedy, root) == 5)
    finally:
        for connection in deaf:
            connection.close()
    assert eventually(lambda: not greedy.holdings("streams"))


def _refused(site, root):
    metrics = site.server.client.get("/metrics", headers=root).text
    start = f'slowtime_twin_over_quota_total{{kind="streams",site="{SECRET}"}} '
    return next(
        int(line[len(start) :]) for line in metrics.splitlines() if line.startswith(start)
    )
