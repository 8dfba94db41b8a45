"""Recordings over REST: taken in once sound, given out to the byte, played, in bounds."""

import datetime
import errno
import io
import os
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from mcap.writer import CompressionType, Writer

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter
from twin_server.serve.access import TokenFile
from twin_server.settings import AccessSettings, DiagnoseSettings, RecordingSettings

BASE = "/api/v1/recordings"
LARGEST = 200_000


def recording(path, messages, *, site=None):
    """Write features as a recorder would; its bytes."""
    with RecordingWriter(path) as writer:
        for message in messages:
            where = site or message.site
            writer.write(FEATURES, where, message.asset, encode(message), message.t_ns)
    return path.read_bytes()


@pytest.fixture(scope="module")
def keeper(serving, tmp_path_factory):
    """A server that keeps recordings, few and small."""
    folder = tmp_path_factory.mktemp("kept")
    server = serving(
        diagnose=DiagnoseSettings(recordings=folder),
        recordings=RecordingSettings(
            max_bytes=LARGEST, max_total_bytes=2 * LARGEST, max_files=6
        ),
    )
    return server, folder


def put(server, name, content, **more):
    return server.client.put(f"{BASE}/{name}", content=content, **more)


def listed(server):
    return {one["name"]: one for one in server.get(BASE).json()["recordings"]}


def test_what_is_given_is_listed_given_back_to_the_byte_and_played(
    keeper, ageing, tmp_path, eventually
):
    server, _ = keeper
    content = recording(tmp_path / "a.mcap", ageing(40, asset="played"))
    taken = put(server, "monday.mcap", content)
    assert taken.status_code == 201
    one = listed(server)["monday.mcap"]
    assert one == taken.json()["recordings"][0]
    assert (one["bytes"], one["twins"]) == (len(content), ["lab.played"])
    assert (one["messages"], one["problem"], one["replay"]) == ({"features": 40}, None, None)
    given = server.get(f"{BASE}/monday.mcap")
    assert given.content == content
    assert "attachment" in given.headers["content-disposition"]

    assert server.client.post(f"{BASE}/monday.mcap/replay", json={}).status_code == 202
    assert eventually(lambda: listed(server)["monday.mcap"]["replay"]["state"] == "done")
    assert server.count("lab.played") == 40
    replay = listed(server)["monday.mcap"]["replay"]
    assert replay["sentence"] == "40 of 40 features are in the twins."
    before = server.get("/api/v1/twins/lab.played/history/hash").json()
    assert server.client.post(f"{BASE}/monday.mcap/replay", json={}).status_code == 202
    assert eventually(lambda: listed(server)["monday.mcap"]["replay"]["state"] == "done")
    assert server.get("/api/v1/twins/lab.played/history/hash").json() == before


def test_a_replay_is_stopped_and_only_one_goes_on_at_a_time(
    keeper, ageing, tmp_path, eventually
):
    server, _ = keeper
    content = recording(tmp_path / "a.mcap", ageing(40, asset="slow"))
    assert put(server, "slow.mcap", content).status_code == 201
    play = f"{BASE}/slow.mcap/replay"
    assert server.client.delete(play).status_code == 409
    assert server.client.post(play, json={"speed": 1.0}).status_code == 202
    again = server.client.post(play, json={})
    assert (again.status_code, again.json()["type"][-12:]) == (409, "being-played")
    assert server.client.delete(f"{BASE}/slow.mcap").status_code == 409
    assert server.client.delete(play).status_code == 200
    assert eventually(lambda: listed(server)["slow.mcap"]["replay"]["state"] == "stopped")
    assert server.client.delete(f"{BASE}/slow.mcap").status_code == 200
    assert server.get(f"{BASE}/slow.mcap").status_code == 404


def no_links(*_names):
    raise PermissionError(errno.EPERM, "Operation not permitted")


def test_a_folder_without_hard_links_keeps_recordings_and_replaces_none(
    keeper, ageing, tmp_path, monkeypatch
):
    server, folder = keeper
    content = recording(tmp_path / "a.mcap", ageing(5))
    monkeypatch.setattr(os, "link", no_links)
    assert put(server, "exfat.mcap", content).status_code == 201
    assert server.get(f"{BASE}/exfat.mcap").content == content
    again = put(server, "exfat.mcap", content)
    assert (again.status_code, again.json()["type"][-13:]) == (409, "there-already")
    assert server.client.delete(f"{BASE}/exfat.mcap").status_code == 200
    monkeypatch.setattr(Path, "replace", no_links)
    before = sorted(path.name for path in folder.iterdir())
    refused = put(server, "exfat.mcap", content)
    assert refused.status_code == 507
    assert "Operation not permitted. Make room on its disk" in refused.json()["detail"]
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize("links", [True, False])
def test_a_name_that_is_taken_while_a_recording_arrives_is_not_replaced(
    keeper, ageing, tmp_path, monkeypatch, links
):
    server, folder = keeper
    content = recording(tmp_path / "a.mcap", ageing(5))
    link, taken = os.link, folder / "taken.mcap"

    def late(partial, path):
        taken.write_bytes(b"of another process")
        (link if links else no_links)(partial, path)

    monkeypatch.setattr(os, "link", late)
    refused = put(server, "taken.mcap", content)
    assert (refused.status_code, refused.json()["type"][-13:]) == (409, "there-already")
    assert taken.read_bytes() == b"of another process"
    taken.unlink()


def bomb():
    """A few kilobytes whose chunk would like to be a gigabyte."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD, chunk_size=2**40)
    writer.start()
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel(FEATURES.key("lab", "beam"), "json", schema)
    for i in range(300):
        writer.add_message(channel, i, bytes(2**20), i)
    writer.finish()
    return out.getvalue()


@pytest.mark.long
def test_what_is_hostile_or_torn_is_refused_and_leaves_nothing(keeper, ageing, tmp_path):
    server, folder = keeper
    sound = recording(tmp_path / "a.mcap", ageing(40))
    damaged = bytearray(sound)
    damaged[len(damaged) // 4] ^= 0xFF
    before = sorted(path.name for path in folder.iterdir())
    packed = bomb()
    assert len(packed) < LARGEST
    endless = sound[:8] + struct.pack("<BQ", 1, 2**63) + sound[8:]
    for content, said in (
        (b"", "is not a recording"),
        (b"#!/bin/sh\n", "is not a recording"),
        (sound[:-20], "breaks off"),
        (bytes(damaged), "damaged"),
        (endless, "damaged"),
        (packed, "MiB|bytes|broke its reader"),
        (recording(tmp_path / "none.mcap", []), "no message"),
    ):
        answer = put(server, "bad.mcap", content)
        assert answer.status_code == 422, answer.text
        detail = answer.json()["detail"]
        assert any(part in detail for part in said.split("|")), detail
        assert str(folder) not in detail
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(
    "name",
    ["..%2fevil.mcap", ".hidden.mcap", "a.txt", "a b.mcap", "x" * 120 + ".mcap", "a%00.mcap"],
)
def test_no_name_leads_out_of_the_folder(keeper, name):
    server, folder = keeper
    assert put(server, name, b"x").status_code in (404, 405, 422)
    assert not [path for path in folder.parent.iterdir() if path.name == "evil.mcap"]


def test_a_recording_is_never_replaced_and_never_too_large(keeper, ageing, tmp_path):
    server, folder = keeper
    content = recording(tmp_path / "a.mcap", ageing(10))
    assert put(server, "kept.mcap", content).status_code == 201
    again = put(server, "kept.mcap", b"something else")
    assert (again.status_code, "only copy" in again.json()["detail"]) == (409, True)
    assert (folder / "kept.mcap").read_bytes() == content
    large = put(server, "large.mcap", bytes(LARGEST + 1))
    assert large.status_code == 413

    def endless():
        for _ in range(100):
            yield bytes(LARGEST // 20)

    assert put(server, "large.mcap", endless()).status_code == 413
    (folder / "filler.mcap").write_bytes(bytes(2 * LARGEST))
    assert put(server, "more.mcap", content).status_code == 507
    broken = listed(server)["filler.mcap"]
    assert "is not a recording" in broken["problem"]
    assert str(folder) not in broken["problem"]
    assert server.client.post(f"{BASE}/filler.mcap/replay", json={}).status_code == 409
    (folder / "filler.mcap").unlink()
    assert not list(folder.glob("*.partial"))


def test_a_trickled_recording_keeps_nobody_else_from_giving_one(keeper, ageing, tmp_path):
    server, folder = keeper
    content = recording(tmp_path / "b.mcap", ageing(5))
    began, go_on = threading.Event(), threading.Event()

    def trickled():
        yield content[:10]
        began.set()
        assert go_on.wait(60)
        yield content[10:]

    with ThreadPoolExecutor(1) as slow:
        giving = slow.submit(put, server, "trickled.mcap", trickled())
        assert began.wait(60)
        assert put(server, "meanwhile.mcap", content).status_code == 201
        doubled = put(server, "trickled.mcap", content)
        assert (doubled.status_code, "already" in doubled.json()["detail"]) == (409, True)
        go_on.set()
        assert giving.result(60).status_code == 201
    for name in ("trickled.mcap", "meanwhile.mcap"):
        assert (folder / name).read_bytes() == content
        assert server.client.delete(f"{BASE}/{name}").status_code == 200


@pytest.mark.long
def test_a_server_that_keeps_none_says_what_to_do(server):
    assert server.get(BASE).json()["kept"] is False
    answer = put(server, "a.mcap", b"x")
    assert answer.status_code == 404
    assert "--recordings FOLDER" in answer.json()["detail"]


@pytest.mark.long
def test_who_asks_sees_only_what_is_all_of_their_sites(serving, ageing, tmp_path):
    folder, day = tmp_path / "kept", datetime.timedelta(days=1)
    folder.mkdir()
    tokens = TokenFile(tmp_path / "tokens.json")
    words = {
        name: tokens.add(name, scope, sites, day)
        for name, scope, sites in (
            ("lab", "operator", ["lab"]),
            ("other", "operator", ["other"]),
            ("viewer", "viewer", ["lab"]),
            ("root", "admin", ["*"]),
        )
    }
    server = serving(
        diagnose=DiagnoseSettings(recordings=folder),
        access=AccessSettings(tokens=tokens.path),
    )
    content = recording(tmp_path / "lab.mcap", ageing(5))

    def ask(who, method, path="", **more):
        headers = {"Authorization": f"Bearer {words[who]}"}
        return httpx.request(
            method, f"{server.url}{BASE}{path}", headers=headers, timeout=300, **more
        )

    beyond = ask("other", "PUT", "/lab.mcap", content=content)
    assert (beyond.status_code, list(folder.iterdir())) == (403, [])
    assert "messages of lab" in beyond.json()["detail"]
    assert ask("viewer", "PUT", "/lab.mcap", content=content).status_code == 403
    assert ask("lab", "PUT", "/lab.mcap", content=content).status_code == 201
    (folder / "odd.mcap").write_bytes(b"nobody knows whose")
    seen = {who: {one["name"] for one in ask(who, "GET").json()["recordings"]} for who in words}
    assert seen == {
        "lab": {"lab.mcap"}, "viewer": {"lab.mcap"}, "other": set(),
        "root": {"lab.mcap", "odd.mcap"},
    }  # fmt: skip
    assert ask("other", "GET", "/lab.mcap").status_code == 404
    assert ask("other", "POST", "/lab.mcap/replay", json={}).status_code == 404
    assert ask("viewer", "POST", "/lab.mcap/replay", json={}).status_code == 403
    assert ask("viewer", "GET", "/lab.mcap").content == content
    assert ask("lab", "DELETE", "/lab.mcap").status_code == 403
    assert ask("root", "DELETE", "/lab.mcap").status_code == 200
