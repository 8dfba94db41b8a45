"""Passes a request to a shard, and its answer back as it comes."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

import h11
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from twin_server.serve.shard_interface import HEADER

Headers = list[tuple[bytes, bytes]]

CONNECT_S = 5.0
"""How long a port of loopback may take to accept [s]; it is full or gone after that."""

CHUNK_BYTES = 1 << 16
"""Most that is read of an answer at once [bytes]: what a socket of loopback holds."""

OF_CONNECTION = frozenset(
    (b"connection", b"keep-alive", b"proxy-authenticate", b"proxy-authorization", b"te",
     b"trailer", b"transfer-encoding", b"upgrade")
)  # fmt: skip
"""Headers of one connection, which are not passed on (RFC 9110, 7.6.1)."""

OF_BROWSER = frozenset(
    (b"host", b"origin", b"forwarded", b"x-forwarded-for", b"x-forwarded-proto", b"expect",
     HEADER)
)  # fmt: skip
"""Headers that the front has judged, or sets itself."""

WITHOUT_BODY = ("GET", "HEAD", "OPTIONS")


class ShardSilentError(ConnectionError):
    """A shard that cannot be reached, or that ended before it answered."""


class ShardAnswer(NamedTuple):
    """A whole answer of a shard."""

    status: int
    headers: Headers
    body: bytes


class _Exchange:
    """One request on a connection of its own, and the answer to it."""

    def __init__(self, url: str, timeout_s: float) -> None:
        parts = urlsplit(url)
        self._host, self._port = parts.hostname or "", parts.port or 0
        self._timeout_s = timeout_s
        self._protocol = h11.Connection(h11.CLIENT)
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def open(self, method: str, target: bytes, headers: Headers) -> None:
        """Connect, and send the head."""
        try:
            self._reader, self._writer = await asyncio.wait_for(
                asyncio.open_connection(self._host, self._port), CONNECT_S
            )
        except (OSError, TimeoutError) as error:
            raise ShardSilentError(str(error)) from error
        host = f"{self._host}:{self._port}".encode()
        await self.send(
            h11.Request(
                method=method,
                target=target,
                headers=[(b"host", host), (b"connection", b"close"), *headers],
            )
        )

    async def send(self, event: h11.Request | h11.Data | h11.EndOfMessage) -> None:
        """Send a part of the request; what a shard no longer reads is left."""
        assert self._writer is not None
        # A shard may refuse a body before it has read it: its answer says why.
        with contextlib.suppress(ConnectionError):
            self._writer.write(self._protocol.send(event) or b"")
            await self._writer.drain()

    async def head(self) -> h11.Response:
        """Wait for the head of the answer."""
        try:
            while True:
                event = await asyncio.wait_for(self._next(), self._timeout_s)
                if isinstance(event, h11.Response):
                    return event
                if not isinstance(event, h11.InformationalResponse):
                    raise ShardSilentError("It closed the connection.")
        except (h11.RemoteProtocolError, OSError, TimeoutError) as error:
            raise ShardSilentError(str(error)) from error

    async def body(self) -> AsyncIterator[bytes]:
        """Read the body, part by part, and close."""
        try:
            while True:
                event = await self._next()
                if not isinstance(event, h11.Data):
                    return
                yield bytes(event.data)
        finally:
            self.close()

    def close(self) -> None:
        """Leave."""
        if self._writer is not None:
            self._writer.close()

    async def _next(self) -> object:
        assert self._reader is not None
        while (event := self._protocol.next_event()) is h11.NEED_DATA:
            self._protocol.receive_data(await self._reader.read(CHUNK_BYTES))
        return event


def passed_on(
    headers: Iterable[tuple[bytes, bytes]], client: str, scheme: str, key: str
) -> Headers:
    """Return the headers of a request as a shard gets them.

    The front has checked where the request came from. The shard counts requests for each
    caller's address, and is told it, and the secret by which it knows the front.
    """
    kept = [
        (name, value)
        for name, value in headers
        if name not in OF_CONNECTION
        and name not in OF_BROWSER
        and not name.startswith(b"sec-fetch-")
    ]
    return [
        *kept,
        (b"sec-fetch-site", b"same-origin"),
        (b"x-forwarded-for", client.encode("latin-1")),
        (b"x-forwarded-proto", scheme.encode()),
        (HEADER, key.encode()),
    ]


def _headers_of(request: Request, key: str) -> Headers:
    client = request.client.host if request.client else "127.0.0.1"
    return passed_on(request.headers.raw, client, request.url.scheme, key)


def _target(request: Request) -> bytes:
    path: bytes = request.scope.get("raw_path") or request.scope["path"].encode()
    query: bytes = request.scope["query_string"]
    return path + (b"?" + query if query else b"")


async def forward(request: Request, url: str, timeout_s: float, key: str) -> Response:
    """Pass a request to the shard at `url`; the answer streams.

    Parameters
    ----------
    timeout_s
        How long the head of the answer may take [s].
    key
        Secret of the fleet.

    Raises
    ------
    ShardSilentError
        If there is no answer.
    """
    exchange = _Exchange(url, timeout_s)
    try:
        headers = _headers_of(request, key)
        has_body = request.method not in WITHOUT_BODY
        if has_body and "content-length" not in request.headers:
            headers.append((b"transfer-encoding", b"chunked"))
        await exchange.open(request.method, _target(request), headers)
        if has_body:
            async for part in request.stream():
                if part:
                    await exchange.send(h11.Data(data=part))
        await exchange.send(h11.EndOfMessage())
        head = await exchange.head()
    except BaseException:
        exchange.close()
        raise
    streaming = StreamingResponse(_body(exchange, head), head.status_code)
    streaming.raw_headers = _of_answer(head.headers)
    return streaming


async def ask(
    request: Request,
    url: str,
    timeout_s: float,
    key: str,
    target: bytes = b"",
    *,
    method: str = "GET",
) -> ShardAnswer:
    """Ask a shard the same (or `target`) without a body, and wait for the whole answer."""
    exchange = _Exchange(url, timeout_s)
    try:
        headers = [
            h for h in _headers_of(request, key) if h[0] not in (b"content-length", b"range")
        ]
        await exchange.open(method, target or _target(request), headers)
        await exchange.send(h11.EndOfMessage())
        head = await exchange.head()
        try:
            body = b"".join([part async for part in exchange.body()])
        except (h11.RemoteProtocolError, OSError) as error:
            raise ShardSilentError(str(error)) from error
    finally:
        exchange.close()
    return ShardAnswer(head.status_code, _of_answer(head.headers), body)


def _of_answer(headers: Sequence[tuple[bytes, bytes]]) -> Headers:
    """Return the headers of an answer without those that the front sets itself."""
    ours = (*OF_CONNECTION, b"date", b"server", b"x-content-type-options",
            b"referrer-policy", b"x-frame-options")  # fmt: skip
    return [(bytes(name), bytes(value)) for name, value in headers if name not in ours]


async def _body(exchange: _Exchange, head: h11.Response) -> AsyncIterator[bytes]:
    """Pass the body on; a live stream of a shard that ends, ends, and the client comes back."""
    live = any(
        n == b"content-type" and v.startswith(b"text/event-stream") for n, v in head.headers
    )
    try:
        async for part in exchange.body():
            yield part
    except (h11.RemoteProtocolError, OSError):
        if not live:
            raise
