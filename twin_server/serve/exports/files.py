"""Streams files while they are made, a few at a time."""

import threading
from collections.abc import AsyncIterable, AsyncIterator, Iterator, Mapping
from typing import Any

import anyio
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from twin_server.serve.http.problems import ProblemError

BEGUN_PIECES = 2
"""Pieces that are made before the status is sent: a heading, and the first that needs the
database, which is answered with 503 where that is away."""

AT_ONCE = 2
"""Pieces that are made at once, of all files; each is a matter of a few ten milliseconds."""


class Files:
    """Files that are under way.

    Parameters
    ----------
    most
        More than so many are refused.
    """

    def __init__(self, most: int) -> None:
        self._most, self._count, self._lock = most, 0, threading.Lock()
        self._makers: anyio.CapacityLimiter | None = None

    def given(self, pieces: Iterator[bytes], kind: str, headers: Mapping[str, str]) -> Response:
        """Return a response that streams a file.

        Raises
        ------
        ProblemError
            503 where others are being given.
        """
        with self._lock:
            if self._count >= self._most:
                raise ProblemError(
                    503,
                    "busy",
                    f"{self._count} files are being given. Allowed: {self._most} at once. Try "
                    "again later.",
                    **{"Retry-After": "10"},
                )
            self._count += 1
        return _File(self, pieces, kind, headers)

    def end(self) -> None:
        """Count one less."""
        with self._lock:
            self._count -= 1

    async def made(self, pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
        """Make pieces in a thread, as they are wanted."""
        if self._makers is None:
            self._makers = anyio.CapacityLimiter(AT_ONCE)
        while True:
            piece = await anyio.to_thread.run_sync(next, pieces, None, limiter=self._makers)
            if piece is None:
                return
            yield piece


class _File(StreamingResponse):
    """One file, given to its end or until its client leaves."""

    def __init__(
        self, files: Files, pieces: Iterator[bytes], kind: str, headers: Mapping[str, str]
    ) -> None:
        super().__init__(files.made(pieces), media_type=kind, headers=headers)
        self._files = files

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        # Who takes nothing of it is cut off by `http.connections`, which ends it.
        try:
            self.body_iterator = await _begun(self.body_iterator)
            await super().__call__(scope, receive, send)
        finally:
            self._files.end()


async def _begun(pieces: AsyncIterable[Any]) -> AsyncIterator[Any]:
    """Make the first pieces, and return all of them."""
    rest = aiter(pieces)
    first = [piece async for piece in _first(rest, BEGUN_PIECES)]

    async def all_pieces() -> AsyncIterator[Any]:
        for piece in first:
            yield piece
        async for piece in rest:
            yield piece

    return all_pieces()


async def _first(pieces: AsyncIterator[Any], count: int) -> AsyncIterator[Any]:
    for _ in range(count):
        try:
            yield await anext(pieces)
        except StopAsyncIteration:
            return
