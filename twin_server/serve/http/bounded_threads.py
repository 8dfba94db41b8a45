"""A bounded number of threads for slow requests, so that the rest stay free."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

import anyio

T = TypeVar("T")


class BoundedThreads:
    """A bounded pool of threads for one purpose; further calls wait.

    Parameters
    ----------
    count
        How many at once.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._limiter: anyio.CapacityLimiter | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    async def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function, run in a thread."""
        loop = asyncio.get_running_loop()
        if self._limiter is None or self._loop is not loop:
            self._limiter, self._loop = anyio.CapacityLimiter(self._count), loop
        return await anyio.to_thread.run_sync(function, limiter=self._limiter)
