"""A bounded number of threads for slow requests, so that the rest stay free."""

from collections.abc import Callable
from typing import TypeVar

import anyio

from twin_server.fairness import FairGate

T = TypeVar("T")


class BoundedThreads:
    """A bounded pool of threads for one purpose; further calls wait for their fair turn.

    Parameters
    ----------
    count
        How many at once.
    """

    def __init__(self, count: int) -> None:
        self._gate = FairGate(count)

    async def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function, run in a thread."""
        async with self._gate:
            return await anyio.to_thread.run_sync(function, limiter=anyio.CapacityLimiter(1))
