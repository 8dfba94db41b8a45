"""Streams files while they are made, a few at a time."""

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterator, Mapping
from typing import Any

from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from twin_server.fairness import OverQuotaError, Quota, QuotaHolding, current_holder
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.quotas import over_quota

RETRY_AFTER_S = 10
"""What a client is told to wait where too many files are given [s]."""

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
        self.quota = Quota("exports", most, setting="serve.max_exports")
        self._makers = BoundedThreads(AT_ONCE)

    def given(self, pieces: Iterator[bytes], kind: str, headers: Mapping[str, str]) -> Response:
        """Return a response that streams a file.

        Raises
        ------
        ProblemError
            503 where others are being given, 429 where too many are to one site or token.
        """
        response = _File(self.made(pieces), media_type=kind, headers=headers)
        what = headers.get("Content-Disposition", "a file")
        try:
            response.holding = self.quota.take(current_holder(), what, response.end)
        except OverQuotaError as error:
            raise over_quota(error, RETRY_AFTER_S) from error
        return response

    async def made(self, pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
        """Make pieces in a thread, as they are wanted."""
        while (piece := await self._makers.run(lambda: next(pieces, None))) is not None:
            yield piece


class _File(StreamingResponse):
    """One file, given to its end, or until its client leaves or it is cancelled."""

    holding: QuotaHolding | None = None
    _task: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        # Who takes nothing of it is cut off by `http.connections`, which ends it.
        self._task = asyncio.ensure_future(self._give(scope, receive, send))
        try:
            await asyncio.wait({self._task})
            if not self._task.cancelled():
                self._task.result()
        finally:
            self._task.cancel()
            if self.holding is not None:
                self.holding.release()

    def end(self) -> None:
        """Give no more of it, in the event loop: its connection is closed in the middle."""
        if self._task is not None:
            self._task.cancel()

    async def _give(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.body_iterator = await _begun(self.body_iterator)
        await super().__call__(scope, receive, send)


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
