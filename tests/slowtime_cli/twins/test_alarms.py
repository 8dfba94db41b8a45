"""`alarms`: a test alarm reaches receivers, or it is said which it has not reached."""

import contextlib
import threading

import pytest

from slowtime_services.bus import MemoryBus
from slowtime_services.client import Client
from tests.twin_server.notify.conftest import Hook
from twin_server.__main__ import run as run_server
from twin_server.settings import TwinSettings


@pytest.fixture
def server(tmp_path):
    """A twin server whose receiver `ops` is there, and whose receiver `deaf` refuses."""
    secret = tmp_path / "secret"
    secret.write_text("a secret that is long enough")
    with contextlib.ExitStack() as stack:
        hooks = {"ops": Hook(), "deaf": Hook(lambda n: 503)}
        receivers = {
            name: {"kind": "webhook", "url": hook.url, "secret_file": str(secret)}
            for name, hook in hooks.items()
        }
        settings = TwinSettings(
            database=tmp_path / "twin.sqlite", port=0, alarms={"receivers": receivers}
        )
        stop, ready, urls = threading.Event(), threading.Event(), []

        def told(url):
            urls.append(url)
            ready.set()

        bus = MemoryBus()
        thread = threading.Thread(
            target=run_server,
            args=(settings,),
            kwargs={"bus": bus, "stop": stop, "ready": told},
        )
        for end in (bus.close, *(hook.close for hook in hooks.values()), thread.join, stop.set):
            stack.callback(end)
        thread.start()
        assert ready.wait(60)
        routes = [{"receiver": name} for name in hooks]
        Client(urls[0]).register("lab.beam", {"alarm_routes": routes})
        Client(urls[0]).register("lab.mast", {})
        yield urls[0], hooks


def test_a_test_alarm_tells_whom_it_has_reached(run, server):
    url, hooks = server
    done = run("twin", "alarms", "test", "lab.beam", "--receiver", "ops", "--server", url)
    assert (done.status, done.out.strip()) == (0, "ops: delivered after 1 try")
    (told,) = hooks["ops"].told
    assert told["test"] is True


def test_a_receiver_that_refuses_is_named_with_its_error_and_the_status_is_1(run, server):
    url, _ = server
    done = run("twin", "alarms", "test", "lab.beam", "--wait-s", 1, "--server", url)
    assert done.status == 1
    assert "ops: delivered" in done.out
    assert "deaf: waiting after" in done.out
    assert "503" in done.out
    assert "1 of 2 receivers have accepted it within 1 s" in done.err
    listed = run("twin", "alarms", "deliveries", "lab.beam", "--server", url)
    rows = [line.split("\t") for line in listed.out.splitlines()]
    assert [row[:4] for row in rows] == [
        ["receiver", "kind", "waiting", "delivered"],
        ["ops", "webhook", "0", "1"],
        ["deaf", "webhook", "1", "0"],
    ]


def test_what_cannot_be_sent_says_what_to_do(run, server):
    url, _ = server
    nowhere = run("twin", "alarms", "test", "lab.mast", "--server", url)
    assert nowhere.status == 2
    assert "lab.mast is routed to: none. Add a route" in nowhere.err
    empty = run("twin", "alarms", "deliveries", "lab.mast", "--server", url)
    assert (empty.status, empty.out) == (0, "")
    assert "its registration has no alarm_routes" in empty.err
    away = run("twin", "alarms", "test", "lab.beam", "--server", "http://127.0.0.1:1")
    assert (away.status, "did not answer" in away.err) == (2, True)
