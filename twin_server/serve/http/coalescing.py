"""Computes one answer for all simultaneous equal requests."""

import asyncio
import concurrent.futures
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class CoalescedCall(Generic[T]):
    """A question that is asked often, and answered once at a time.

    Parameters
    ----------
    find
        Finds the answer; may wait for a disk.
    name
        Of the thread.
    """

    def __init__(self, find: Callable[[], T], name: str) -> None:
        self._find = find
        self._thread = concurrent.futures.ThreadPoolExecutor(1, name)
        self._asked: concurrent.futures.Future[T] | None = None

    async def ask(self) -> T:
        """Return the answer being computed, or compute one."""
        if self._asked is None or self._asked.done():
            self._asked = self._thread.submit(self._find)
        return await asyncio.shield(asyncio.wrap_future(self._asked))
