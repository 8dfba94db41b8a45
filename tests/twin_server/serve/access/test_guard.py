"""What the door does beyond the table: sites, cookies, rates, hosts."""

import asyncio
import dataclasses
import datetime
import time
from typing import Any

import httpx
import pytest

from twin_server.fairness import Holder, OverQuotaError, acting_for
from twin_server.serve import Hub
from twin_server.serve.access import EVERYBODY, NotSecuredError, TokenFile, guarded
from twin_server.serve.access.guard import COOKIE
from twin_server.settings import TwinSettings

TWINS = "/api/v1/twins"


async def nothing(scope, receive, send):
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def knock(guard, method="GET", path="/healthz", host="127.0.0.1", **more):
    async def once():
        transport = httpx.ASGITransport(guard)
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{host}") as client:
            return await client.request(method, path, **more)

    return asyncio.run(once())


def test_a_list_shows_the_twins_of_ones_own_sites_only(door):
    def seen(caller):
        answer = door.ask("GET", TWINS, door.words[caller])
        return [twin["id"] for twin in answer.json()["twins"]]

    assert seen("viewer") == ["lab.beam"]
    assert seen("other site") == ["other.secret"]
    assert set(seen("admin of all")) == {"lab.beam", "other.secret"}


def test_no_refusal_names_a_twin_of_another_site(door):
    answer = door.ask("GET", f"{TWINS}/lab.nothing", door.words["viewer"])
    assert answer.status_code == 404
    assert "lab.beam" in answer.text
    assert "other" not in answer.text
    there = door.ask("GET", f"{TWINS}/other.secret", door.words["viewer"])
    nowhere = door.ask("GET", f"{TWINS}/other.nothing", door.words["viewer"])
    assert there.status_code == nowhere.status_code == 403
    assert there.json()["detail"] == nowhere.json()["detail"]


def test_a_page_keeps_its_token_in_a_cookie_that_no_script_reads(door):
    word = door.words["operator"]
    answer = door.ask("POST", "/api/v1/session", word)
    cookie = answer.headers["set-cookie"]
    assert all(part in cookie for part in ("HttpOnly", "SameSite=strict", "Max-Age=86"))
    assert word not in answer.text
    headers = {"Cookie": f"{COOKIE}={word}"}
    assert door.ask("GET", f"{TWINS}/lab.beam", headers=headers).status_code == 200
    who = door.ask("GET", "/api/v1/session", headers=headers).json()
    assert (who["scope"], who["sites"]) == ("operator", ["lab"])
    assert "Max-Age=0" in door.ask("DELETE", "/api/v1/session").headers["set-cookie"]


@pytest.mark.parametrize(
    ("more", "status"),
    [
        ({}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://127.0.0.1"}, 200),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
        ({"Sec-Fetch-Site": "cross-site", "Origin": "http://127.0.0.1"}, 403),
    ],
)
def test_a_cookie_does_nothing_for_another_page(door, more, status):
    headers = {"Cookie": f"{COOKIE}={door.words['operator']}", **more}
    assert door.ask("PUT", f"{TWINS}/lab.beam", headers=headers, json={}).status_code == status


FROM_ELSEWHERE = [
    {"Origin": "http://evil.example"},
    {"Origin": "http://evil.example:80"},
    {"Origin": "http://127.0.0.1.evil.example"},
    {"Origin": "null"},
    {"Origin": ""},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "cross-site", "Origin": "http://127.0.0.1"},
    {"Sec-Fetch-Site": "whatever"},
]
FROM_HERE = [
    {},
    {"Origin": "http://127.0.0.1"},
    {"Origin": "http://127.0.0.1:8000"},
    {"Sec-Fetch-Site": "same-origin"},
    {"Sec-Fetch-Site": "same-site", "Origin": "http://127.0.0.1:3000"},
    {"Sec-Fetch-Site": "none"},
    {"Sec-Fetch-Site": "same-origin", "Origin": "https://before.the.proxy.example"},
]
"""The last is a proxy that asks by another name."""


@pytest.mark.parametrize("with_token", [False, True])
def test_a_page_of_another_site_changes_nothing(door, tmp_path, with_token):
    """With a token in the header, and of a server without any."""
    if not with_token:
        settings = TwinSettings(database=tmp_path / "x.sqlite")
        door = dataclasses.replace(door, guard=guarded(settings).around(door.app))
    headers = {"Authorization": f"Bearer {door.words['admin of all']}"} if with_token else {}
    asked: list[tuple[str, str, dict[str, Any]]] = [
        ("PUT", f"{TWINS}/lab.beam", {"json": {}}),
        ("POST", f"{TWINS}/lab.beam/simulate", {"content": b"{}"}),
        ("POST", "/api/v1/recordings/a.mcap/replay", {"content": b"{}"}),
        ("DELETE", f"{TWINS}/lab.nowhere", {}),
        ("DELETE", "/api/v1/recordings/a.mcap", {}),
    ]
    for method, path, more in asked:
        for strange in FROM_ELSEWHERE:
            answer = door.ask(method, path, headers=headers | strange, **more)
            assert answer.status_code == 403, (method, path, strange)
            assert "page of another site" in answer.json()["detail"]
        for sound in FROM_HERE:
            answer = door.ask(method, path, headers=headers | sound, **more)
            assert answer.status_code != 403, (method, path, sound)
    for strange in FROM_ELSEWHERE:
        assert door.ask("GET", TWINS, headers=headers | strange).status_code == 200


@pytest.mark.parametrize(
    "given",
    ["Bearer", "Bearer ", "Basic YTpi", "Bearer x", "Bearer slowtime_00000000_" + "A" * 43,
     "Bearer " + "x" * 20_000, "Bearer slowtime_\u00e4"],
)  # fmt: skip
def test_what_is_no_token_lets_nobody_in_and_is_not_repeated(door, given):
    answer = door.ask("GET", TWINS, headers={"Authorization": given.encode("latin-1")})
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"].startswith("Bearer")
    text = given.partition(" ")[2]
    assert len(text) < 3 or text not in answer.text


def test_one_changed_character_of_a_token_lets_nobody_in(door):
    word = door.words["viewer"]
    for place in range(len("slowtime_00000000_"), len(word), 7):
        other = word[:place] + ("A" if word[place] != "A" else "B") + word[place + 1 :]
        assert door.ask("GET", TWINS, other).status_code == 401


def test_who_asks_too_often_waits_and_keeps_nobody_else_from_asking(tmp_path):
    tokens = TokenFile(tmp_path / "tokens.json")
    ann, bob = (
        tokens.add(name, "viewer", ["*"], datetime.timedelta(1)) for name in ("ann", "bob")
    )
    access = {"tokens": tokens.path, "requests_per_s": 0.1, "burst": 5, "failures_burst": 3}
    guard = guarded(TwinSettings(access=access)).around(nothing)

    def statuses(count, **headers):
        return [knock(guard, path=TWINS, headers=headers).status_code for _ in range(count)]

    assert statuses(7, Authorization=f"Bearer {ann}") == [204] * 5 + [429] * 2
    assert statuses(5, Authorization="Bearer guess") == [401] * 3 + [429] * 2
    assert statuses(1, Authorization=f"Bearer {bob}") == [204]
    answer = knock(guard, path=TWINS, headers={"Authorization": f"Bearer {ann}"})
    assert 0 < int(answer.headers["retry-after"]) <= 10


def test_a_server_without_tokens_answers_to_its_own_machine_only():
    guard = guarded(TwinSettings(access={"hosts": ["twin.lab"]})).around(nothing)
    for host in ("127.0.0.1:8000", "localhost", "[::1]:8000", "twin.lab:8000"):
        assert knock(guard, host=host).status_code == 204
    answer = knock(guard, host="evil.example:8000")
    assert answer.status_code == 421
    assert "answers to its own machine only" in answer.json()["detail"]


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "10.0.0.2", "twin.lab"])
def test_beyond_this_machine_it_listens_only_encrypted_and_with_tokens(tmp_path, host):
    tokens = TokenFile(tmp_path / "tokens.json")
    tokens.add("ann", "viewer", ["*"], datetime.timedelta(1))
    tls = {"certificate": "c.pem", "key": "k.pem"}
    some = {"tokens": tokens.path}
    cases: list[tuple[dict[str, Any], str]] = [
        ({}, "no encryption .* and no authentication"),
        ({"tls": tls}, r"has no authentication \(--tokens"),
        ({"access": some}, r"has no encryption \(--tls-certificate"),
        ({"access": {"behind_proxy": True}}, "has no authentication"),
    ]
    for more, lacks in cases:
        with pytest.raises(NotSecuredError, match=lacks):
            guarded(TwinSettings(host=host, **more))
    guarded(TwinSettings(host=host, tls=tls, access=some))
    guarded(TwinSettings(host=host, access=some | {"behind_proxy": True}))
    guarded(TwinSettings(host=host, access={"published_on_loopback": True}))


def test_everybody_is_nobody_of_a_token():
    assert EVERYBODY.to_dict()["until"] is None
    assert EVERYBODY.until > time.time()


def test_the_streams_of_one_token_are_counted():
    async def join_many():
        hub = Hub(max_clients=10, backlog=16, max_of_one=2)

        def join(token):
            with acting_for(Holder("lab", token)):
                return hub.join("lab.beam")

        first, _ = join("ann"), join("ann")
        with pytest.raises(OverQuotaError, match="2 streams of your token"):
            join("ann")
        assert join("bob") is not None
        hub.leave(first)
        assert join("ann") is not None
        with pytest.raises(OverQuotaError):
            join("ann")

    asyncio.run(join_many())
