"""Connections that say nothing, trickle or do not listen are cut off, and stop nobody else."""

import asyncio
import contextlib
import logging
import socket
import threading
import time

import pytest
import uvicorn

from twin_server.serve.http.connections import ConnectionLimits, Connections

PATIENCE_S = 60.0
LARGE = 24 * 2**20


class Small:
    """A server of three addresses: one answers, one takes a body, one gives a large answer."""

    def __init__(self, limits):
        self.connections = Connections(limits)
        self.entered, self.left = threading.Semaphore(0), threading.Semaphore(0)
        self.go_on = threading.Event()
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.port = self.listening.getsockname()[1]
        config = uvicorn.Config(
            self.app, http=self.connections.protocol(), log_config=None, lifespan="off",
            ws="none", interface="asgi3",
            limit_concurrency=limits.most, timeout_graceful_shutdown=1,
        )  # fmt: skip
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(
            target=self.server.run, kwargs={"sockets": [self.listening]}, daemon=True
        )

    async def app(self, scope, receive, send):
        if scope["path"] == "/slow":
            self.entered.release()
            while not self.go_on.is_set():
                await asyncio.sleep(0.01)
        read, message = 0, {"more_body": True}
        while message.get("more_body"):
            message = await receive()
            read += len(message.get("body", b""))
            if message["type"] == "http.disconnect":
                self.left.release()
                return
        size = LARGE if scope["path"] == "/large" else 2
        head = [(b"content-length", str(size).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": head})
        await send({"type": "http.response.body", "body": b"o" * size})

    def __enter__(self):
        self.thread.start()
        self.until(lambda: self.server.started)
        return self

    def __exit__(self, *_):
        self.go_on.set()
        self.server.should_exit = True
        self.thread.join(PATIENCE_S)
        self.listening.close()

    def until(self, holds):
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end, "It did not happen."
            time.sleep(0.01)

    def open(self, said=b"", source="127.0.0.1"):
        one = socket.create_connection(("127.0.0.1", self.port), PATIENCE_S, (source, 0))
        one.sendall(said)
        return one

    def ask(self, path="/", source="127.0.0.1"):
        with self.open(f"GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode(),
                       source) as one:  # fmt: skip
            return everything(one)

    @property
    def count(self):
        return self.connections._count


def everything(one):
    """Read until the other side ends it."""
    found = bytearray()
    with contextlib.suppress(ConnectionResetError):
        while part := one.recv(65_536):
            found += part
    return bytes(found)


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: x\r\nX-"])
def test_many_half_open_connections_of_one_address_leave_room_for_others(said):
    limits = ConnectionLimits(head_s=600.0, most=50, most_of_one=30)
    with Small(limits) as small, contextlib.ExitStack() as opened:
        crowd = [opened.enter_context(small.open(said)) for _ in range(120)]
        for source in ("127.0.0.2", "127.0.0.1", "127.0.0.3"):
            assert small.ask(source=source).startswith(b"HTTP/1.1 200")
        assert small.count <= 30
        # Those that came last are still there.
        crowd[-1].sendall(b"A: b\r\n\r\n" if said else b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        assert crowd[-1].recv(100).startswith(b"HTTP/1.1 200")


def test_one_address_that_is_being_answered_everywhere_is_told_so_and_others_are_served():
    with (
        Small(ConnectionLimits(most=50, most_of_one=5)) as small,
        contextlib.ExitStack() as opened,
    ):
        asked = b"GET /slow HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
        busy = [opened.enter_context(small.open(asked)) for _ in range(5)]
        for _ in busy:
            assert small.entered.acquire(timeout=PATIENCE_S)
        told = small.ask()
        assert told.startswith(b"HTTP/1.1 503")
        assert b"Allowed: 5 of one address" in told
        assert small.ask(source="127.0.0.2").startswith(b"HTTP/1.1 200")
        small.go_on.set()
        assert all(everything(one).startswith(b"HTTP/1.1 200") for one in busy)
        small.until(lambda: small.count == 0)
        assert small.ask().startswith(b"HTTP/1.1 200")


def test_a_head_that_never_ends_is_cut_off():
    with Small(ConnectionLimits(head_s=0.3)) as small:
        with small.open(b"GET / HTTP/1.1\r\nHost:") as one:
            told = everything(one)
            assert told.startswith(b"HTTP/1.1 408")
            assert b"head-too-slow" in told
        with small.open() as one:
            assert everything(one) == b""
        endless = b"GET / HTTP/1.1\r\n" + b"X: " + b"y" * 200_000
        with small.open() as one:
            with contextlib.suppress(OSError):
                one.sendall(endless)
                one.sendall(endless)
            everything(one)
        with small.open(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n") as one:
            assert one.recv(100).startswith(b"HTTP/1.1 200")
            one.sendall(b"GET / HT")  # the second request, after a pause
            assert b"HTTP/1.1 408" in everything(one)
        small.until(lambda: small.count == 0)


@pytest.mark.parametrize("length", [b"Content-Length: 100000", b"Transfer-Encoding: chunked"])
def test_a_trickled_body_is_cut_off_and_stops_nobody_else(length):
    limits = ConnectionLimits(body_s=0.2, slowest_bytes_per_s=1e5)
    with Small(limits) as small:
        with small.open(b"POST / HTTP/1.1\r\nHost: x\r\n" + length + b"\r\n\r\n") as one:
            assert small.ask().startswith(b"HTTP/1.1 200")
            told = everything(one)
            assert told.startswith(b"HTTP/1.1 408")
            assert b"bytes a second" in told
        assert small.left.acquire(timeout=PATIENCE_S)
        small.until(lambda: small.count == 0)


def test_a_body_that_takes_too_long_in_all_is_cut_off():
    limits = ConnectionLimits(body_s=600.0, upload_s=0.2)
    with (
        Small(limits) as small,
        small.open(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\nabc") as one,
    ):
        assert b"0.2 s in all" in everything(one)


def test_who_takes_no_answer_is_cut_off():
    limits = ConnectionLimits(body_s=0.5, slowest_bytes_per_s=1e5)
    with Small(limits) as small:
        with small.open(b"GET /large HTTP/1.1\r\nHost: x\r\n\r\n") as one:
            small.until(lambda: small.connections.counts["answer_not_taken"] == 1)
            assert len(everything(one)) < LARGE
        assert len(small.ask("/large")) > LARGE


def test_a_body_that_is_waited_for_by_the_server_is_not_slow():
    """What the application does not read yet is not held against the client."""
    limits = ConnectionLimits(body_s=0.1, slowest_bytes_per_s=1e7)
    body = b"x" * 400_000
    with Small(limits) as small:
        head = (
            b"POST /slow HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: %d\r\n\r\n"
        )
        with small.open() as one:
            sending = threading.Thread(target=one.sendall, args=(head % len(body) + body,))
            sending.start()
            assert small.entered.acquire(timeout=PATIENCE_S)
            time.sleep(2.5)
            small.go_on.set()
            assert everything(one).startswith(b"HTTP/1.1 200")
            sending.join(PATIENCE_S)


@pytest.mark.long
def test_a_client_that_leaves_is_nobodys_fault(server, caplog):
    caplog.set_level(logging.WARNING)
    address = server.client.base_url.host, server.client.base_url.port
    path = "/api/v1/twins/lab.beam"
    heads = [
        f"POST {path}/simulate HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        "Content-Type: application/json\r\nContent-Length: 9000\r\n\r\n{",
        f"GET {path}/forecast?at=slow:250 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        f"GET {path}/history/export HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        "PUT /api/v1/recordings/left.mcap HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        "Content-Length: 9000\r\n\r\nxyz",
    ]
    for head in heads:
        for _ in range(2):
            with socket.create_connection(address, PATIENCE_S) as one:
                one.sendall(head.encode())
    assert server.get("/healthz").status_code == 200
    assert server.get(f"{path}/forecast").status_code == 200
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]
