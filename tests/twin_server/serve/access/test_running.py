"""A running server: TLS, streams that end with their token, and no secret said anywhere."""

import datetime
import json
import logging
import socket
import ssl
import threading

import httpx
import pytest

from edge_agent.__main__ import _about
from edge_agent.settings import EdgeSettings
from slowtime_services.bus import MemoryBus
from slowtime_services.credentials import Authority
from twin_server.__main__ import run
from twin_server.serve import live
from twin_server.serve.access import TokenFile
from twin_server.serve.access.guard import COOKIE
from twin_server.settings import AccessSettings, TlsSettings, TwinSettings

DAY = datetime.timedelta(days=1)
TWIN = "/api/v1/twins/lab.beam"


@pytest.fixture(scope="module")
def tokens(tmp_path_factory):
    return TokenFile(tmp_path_factory.mktemp("tokens") / "tokens.json")


@pytest.fixture(scope="module")
def admin(tokens):
    return tokens.add("root", "admin", ["*"], DAY)


@pytest.fixture(scope="module")
def guarded_server(serving, tokens, admin):
    started = serving(access=AccessSettings(tokens=tokens.path))
    started.client.headers["Authorization"] = f"Bearer {admin}"
    assert started.client.put(TWIN, json={}).status_code == 201
    return started


def test_a_stream_ends_with_its_token(guarded_server, tokens, monkeypatch, ageing):
    monkeypatch.setattr(live, "PING_S", 0.1)
    word = tokens.add("ann", "viewer", ["lab"], DAY)
    headers = {"Authorization": f"Bearer {word}"}
    with httpx.stream(
        "GET", f"{guarded_server.url}{TWIN}/live", headers=headers, timeout=300
    ) as stream:
        lines = stream.iter_lines()
        assert next(lines).startswith("retry:")
        guarded_server.feed(ageing(3))
        assert any(line.startswith("event: state") for line in lines)
        tokens.revoke(word.split("_")[1])
        rest = list(lines)  # comes to an end
    assert not any(line.startswith("event: state") for line in rest[-1:])
    again = httpx.get(f"{guarded_server.url}{TWIN}", headers=headers, timeout=300)
    assert again.status_code == 401
    assert again.json()["detail"].startswith("The token is refused. It is revoked.")


def test_a_cookie_is_good_for_a_stream_as_of_a_page(guarded_server, tokens):
    word = tokens.add("ann", "viewer", ["lab"], DAY)
    with httpx.Client(base_url=guarded_server.url, timeout=300) as page:
        begun = page.post("/api/v1/session", headers={"Authorization": f"Bearer {word}"})
        assert begun.status_code == 200
        assert page.get(TWIN).status_code == 200
        with page.stream("GET", f"{TWIN}/live") as stream:
            assert next(stream.iter_lines()).startswith("retry:")
        page.delete("/api/v1/session")
        assert page.get(TWIN).status_code == 401


def test_no_secret_is_said_in_logs_or_answers(guarded_server, tokens, admin, caplog):
    said = []
    with caplog.at_level(logging.DEBUG):
        guess = "slowtime_00000000_" + "Z" * 43
        for word in (admin, guess, f"{admin}x"):
            for headers in (
                {"Authorization": f"Bearer {word}"},
                {"Authorization": f"Basic {word}"},
                {"Cookie": f"{COOKIE}={word}", "Authorization": ""},
            ):
                for method, path in (
                    ("GET", "/api/v1/twins"),
                    ("POST", "/api/v1/session"),
                    ("PUT", TWIN),
                    ("GET", f"{TWIN}/history?max_points=x"),
                    ("GET", "/readyz"),
                ):
                    answer = guarded_server.client.request(
                        method, path, headers=headers, content=b"{not json"
                    )
                    said.append(answer.text)
    # What httpx logs is what this test has sent, and been sent.
    logged = [r.getMessage() for r in caplog.records if not r.name.startswith("http")]
    text = "\n".join([*said, *logged])
    _, _, secret = admin.split("_", 2)  # which may have "_" in itself
    assert len(secret) == 43
    for word in (admin, secret, guess):
        assert word not in text
    assert tokens.path.with_name("tokens.json.key").read_text() not in text


def test_no_secret_of_an_edge_travels_or_is_recorded(tmp_path):
    settings = EdgeSettings(
        credentials=tmp_path / "keys-of-mine",
        zenoh={"transport/auth/usrpwd/password": "hunter2"},
        connect=("tls/10.9.8.7:7447",),
    )
    for told in (json.dumps(_about(settings)), repr(settings)):
        assert "hunter2" not in told
    assert "keys-of-mine" not in json.dumps(_about(settings))
    assert "10.9.8.7" not in json.dumps(_about(settings))


def test_beyond_this_machine_it_speaks_tls(tmp_path, tokens, admin):
    authority = Authority.open(tmp_path / "keys", "lab")
    folder = authority.issue("server", hosts=["127.0.0.1"])
    settings = TwinSettings(
        host="0.0.0.0",
        port=0,
        database=tmp_path / "twin.sqlite",
        tls=TlsSettings(certificate=folder / "certificate.pem", key=folder / "key.pem"),
        access=AccessSettings(tokens=tokens.path),
    )
    stop, ready = threading.Event(), threading.Event()
    urls: list[str] = []

    def told(url):
        urls.append(url)
        ready.set()

    thread = threading.Thread(
        target=run,
        args=(settings,),
        kwargs={
            "bus": MemoryBus(),
            "stop": stop,
            "ready": told,
        },
    )
    thread.start()
    try:
        assert ready.wait(60)
        url = urls[0].replace("0.0.0.0", "127.0.0.1")
        assert url.startswith("https://")
        trust = ssl.create_default_context(cafile=str(folder / "ca.pem"))
        headers = {"Authorization": f"Bearer {admin}"}
        with httpx.Client(base_url=url, headers=headers, verify=trust, timeout=300) as client:
            assert client.get("/api/v1/twins").status_code == 200
            begun = client.post("/api/v1/session")
        assert "Secure" in begun.headers["set-cookie"]
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"{url.replace('https', 'http')}/healthz", timeout=300)
    finally:
        stop.set()
        thread.join(60)


def test_a_server_that_strangers_could_ask_does_not_start(tmp_path, caplog):
    settings = TwinSettings(host="0.0.0.0", port=0, database=tmp_path / "twin.sqlite")
    assert run(settings, bus=MemoryBus()) == 2
    assert "no encryption" in caplog.text
    assert "no authentication" in caplog.text
    assert not (tmp_path / "twin.sqlite").exists()


def test_a_head_that_never_ends_is_cut_off(guarded_server):
    where = httpx.URL(guarded_server.url)
    with socket.create_connection((where.host, where.port), timeout=300) as line:
        line.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")
        with pytest.raises(OSError, match=r"reset|pipe"):
            line.sendall(b"y" * (1 << 25))
    # One that ends is answered, and so are several on one line.
    long = {"X-Long": "y" * 60_000}
    for _ in range(3):
        assert guarded_server.client.get("/healthz", headers=long).status_code == 200


@pytest.mark.long
@pytest.mark.browser
def test_the_page_asks_for_a_token_and_shows_its_twins(guarded_server, tokens, visit):
    from playwright.sync_api import expect

    word = tokens.add("ann", "viewer", ["lab"], DAY)
    page = visit(guarded_server)
    expect(page.get_by_role("heading", name="Sign in with a token")).to_be_visible()
    page.get_by_label("Token").fill("wrong")
    page.get_by_role("button", name="Enter").click()
    expect(page.locator("#not-admitted")).to_contain_text("The token is refused.")
    page.get_by_label("Token").fill(word)
    page.get_by_role("button", name="Enter").click()
    expect(page.locator('[data-twin="lab.beam"]')).to_be_visible()
    expect(page.get_by_role("heading", name="Sign in with a token")).to_be_hidden()
    expect(page.locator("#connection")).to_have_text("live")
    assert word not in page.evaluate("document.cookie")
