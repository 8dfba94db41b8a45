"""A bounded number of threads for slow requests, so that the rest stay free."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

import anyio

T = TypeVar("T")


class BoundedThreads:
    """Threads of one purpose; who asks beyond them waits.

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
        """Give what a function gives, in a thread."""
        loop = asyncio.get_running_loop()
        if self._limiter is None or self._loop is not loop:
            self._limiter, self._loop = anyio.CapacityLimiter(self._count), loop
        return await anyio.to_thread.run_sync(function, limiter=self._limiter)
