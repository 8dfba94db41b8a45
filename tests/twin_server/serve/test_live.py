"""The live stream: everything once, resumable, and nobody's slowness another's trouble."""

import asyncio
import json
import threading
from importlib.resources import files
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from twin_server.history.states import blank
from twin_server.serve import HistoryPart, live
from twin_server.serve.live import RESET, Hub, Item, LiveClient, LiveResponse
from twin_server.settings import ServeSettings

LIVE = "/api/v1/twins/lab.beam/live"


def read(server, count, *, last_id=None, timeout_s=60.0, started=None):
    """The next `count` (id, event, data) of the stream."""
    headers = {"Last-Event-ID": last_id} if last_id else {}
    found, current = [], {}
    with httpx.stream("GET", server.url + LIVE, headers=headers, timeout=timeout_s) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            if line.startswith("retry") and started is not None:
                started.set()
            name, _, value = line.partition(": ")
            if line and name in ("id", "event", "data"):
                current[name] = value
            elif not line and "data" in current:
                found.append((current["id"], current["event"], json.loads(current["data"])))
                current = {}
                if len(found) == count:
                    return found
    return found


@pytest.fixture
def own(serving, ageing, eventually):
    server = serving()
    server.feed(ageing(30))
    assert eventually(lambda: server.count() == 30)
    return server


def test_a_new_client_gets_the_latest_state_and_what_follows(own, ageing):
    started = threading.Event()

    def feed():
        started.wait(60)
        own.feed(ageing(10, first=30))

    feeding = threading.Thread(target=feed)
    feeding.start()
    found = read(own, 11, started=started)
    feeding.join()
    assert [event for _, event, _ in found] == ["state"] * 11
    assert [data["sequence"] for _, _, data in found] == list(range(29, 40))


def test_a_client_that_comes_back_is_told_what_it_missed(own, ageing, eventually):
    ((last_id, _, _),) = read(own, 1)
    own.feed(ageing(20, first=30))
    assert eventually(lambda: own.count() == 50)
    body = {"nominal": {"frequency_hz": 3.0}}
    own.client.put("/api/v1/twins/lab.beam", json=body)
    found = read(own, 21, last_id=last_id)
    assert [d["sequence"] for _, kind, d in found if kind == "state"] == list(range(30, 50))
    assert [d["kind"] for _, kind, d in found if kind == "event"] == ["registered"]
    # Resuming from any id gives exactly what followed it.
    middle = found[7][0]
    rest = read(own, 13, last_id=middle)
    assert [d.get("sequence") for _, _, d in rest] == [
        d.get("sequence") for _, _, d in found[8:]
    ]


def test_nonsense_as_the_last_id_is_a_new_client_after_a_reset(own):
    (_, reset, _), (_, kind, data) = read(own, 2, last_id="'; drop table features")
    assert (reset, kind, data["sequence"]) == ("reset", "state", 29)


def test_registering_anew_resets_those_who_watch(own):
    started = threading.Event()

    def register():
        started.wait(60)
        own.client.put("/api/v1/twins/lab.beam", json={"changes": "mass"})

    thread = threading.Thread(target=register)
    thread.start()
    found = read(own, 2, started=started)
    thread.join()
    assert [kind for _, kind, _ in found] == ["state", "reset"]


def test_more_clients_than_allowed_are_told_to_come_later(serving, ageing, eventually):
    server = serving(serve=ServeSettings(max_live_clients=1))
    server.feed(ageing(3))
    assert eventually(lambda: server.count() == 3)
    with httpx.stream("GET", server.url + LIVE, timeout=30) as first:
        lines = first.iter_lines()  # closed with its last reference, and the stream with it
        next(lines)
        second = server.get(LIVE)
        assert second.status_code == 503
        assert second.headers["retry-after"] == "5"
        assert second.json()["type"] == "urn:slowtime:problem:too-many-clients"
    assert eventually(lambda: "live_clients 0" in server.get("/metrics").text)
    assert read(server, 1)


def nothing_missed() -> Any:
    """Knowledge of a twin whose client has seen everything."""
    nothing = HistoryPart(blank(0), [], [], [])
    return SimpleNamespace(
        latest=lambda *_: nothing, since=lambda *_: nothing, events=lambda *_, **__: []
    )


def joined(hub):
    client = hub.join("lab.beam")
    assert client is not None
    return client


def tell(hub, count):
    states = blank(count)
    states["sequence"] = range(count)
    hub.tell("lab.beam", states, [(1, "b1", "s")] * count, [])


def test_a_client_that_does_not_read_is_cut_off_and_others_go_on(monkeypatch, caplog):
    monkeypatch.setattr(live, "STUCK_S", 0.05)

    async def play():
        hub, knowledge = Hub(10, 100), nothing_missed()
        sent: list[bytes] = []

        async def never(message):
            if message["type"] == "http.response.body":
                await asyncio.Event().wait()

        async def gladly(message):
            sent.append(message.get("body", b""))

        async def connected():
            await asyncio.Event().wait()

        answers = [LiveResponse(hub, joined(hub), knowledge, ":0-0") for _ in range(2)]
        tasks = [
            asyncio.create_task(answer({"type": "http"}, connected, send))
            for answer, send in zip(answers, (never, gladly), strict=True)
        ]
        await asyncio.wait_for(tasks[0], 5)
        tell(hub, 3)
        await asyncio.sleep(0.05)
        counted = hub.count, hub.dropped
        hub.close()
        await asyncio.wait_for(tasks[1], 5)
        return counted, b"".join(sent)

    counted, sent = asyncio.run(play())
    assert counted == (1, 1)
    assert sent.count(b"event: state") == 3
    assert "reads nothing" in caplog.text


def test_a_client_that_reads_too_slowly_is_cut_off(caplog):
    async def play():
        hub = Hub(10, 20)
        clients = [joined(hub) for _ in range(2)]
        for _ in range(5):
            tell(hub, 8)
            await asyncio.sleep(0.01)
            clients[1].take()
        return [client.ended for client in clients], hub.dropped

    assert asyncio.run(play()) == ([True, False], 1)
    assert "too slow and is disconnected" in caplog.text


def test_the_server_ends_though_clients_watch(serving, ageing, eventually):
    server = serving(shutdown_s=600.0)  # nobody is cut off
    server.feed(ageing(3))
    assert eventually(lambda: server.count() == 3)
    ended = []

    def watch():
        ended.append(read(server, 10**9))

    watchers = [threading.Thread(target=watch) for _ in range(5)]
    for watcher in watchers:
        watcher.start()
    assert eventually(lambda: "live_clients 5" in server.get("/metrics").text)
    server.stop.set()
    server.thread.join(60)
    assert not server.thread.is_alive()
    assert server.result == [0]
    for watcher in watchers:
        watcher.join(60)
        assert not watcher.is_alive()
    assert len(ended) == 5


def test_nothing_is_rendered_for_a_twin_nobody_watches():
    hub = Hub(10, 100)
    tell(hub, 1)
    hub.reset("lab.beam")


def test_more_at_once_than_one_may_be_behind_is_a_reset_and_the_newest():
    async def play():
        hub = Hub(10, 20)
        client = joined(hub)
        tell(hub, 500)
        await asyncio.sleep(0.01)
        return client.take()

    first, second = asyncio.run(play())
    assert first is RESET
    assert second.key == (1 << 40) + 499


def test_a_client_too_far_behind_ends_and_holds_nothing():
    async def play():
        client = LiveClient("lab.beam", 3)
        assert client.offer([Item(1, 0, "")] * 3)
        assert not client.offer([Item(2, 0, "")])
        return client

    client = asyncio.run(play())
    assert client.ended
    assert client.take() == []


def test_the_page_knows_every_kind_of_event_of_the_stream():
    script = (files("twin_server.serve") / "web/twin.js").read_text()
    for kind in ("state", "event", "reset"):
        assert f'stream.addEventListener("{kind}"' in script


@pytest.mark.parametrize("ahead", ["{boot}:999999999999-0", "{boot}:29-" + "9" * 18])
def test_a_last_id_ahead_of_all_there_is_resets_and_what_follows_is_told(own, ageing, ahead):
    """After a backup was restored, clients have seen what the server has not."""
    ((last_id, _, _),) = read(own, 1)
    started = threading.Event()

    def feed():
        started.wait(60)
        own.feed(ageing(3, first=30))

    thread = threading.Thread(target=feed)
    thread.start()
    last_id = ahead.format(boot=last_id.partition(":")[0])
    found = read(own, 5, last_id=last_id, started=started)
    thread.join()
    assert [kind for _, kind, _ in found] == ["reset"] + ["state"] * 4
    assert [data["sequence"] for _, _, data in found[1:]] == [29, 30, 31, 32]
