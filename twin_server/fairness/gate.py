"""A bounded number of turns in an event loop, given to who has used least.

It is an asynchronous context manager, so that it stands wherever a semaphore or a capacity
limiter would; whose turn it is, is told by the context (`current_holder`).
"""

import asyncio
import collections
import time
from collections import Counter
from typing import Any

from .holders import ALONE, Holder, current_holder
from .quota import may_take
from .usage import DecayedUsage

ALPHA = 2
"""Ratio of the turns of a site to those that are free [1]: of two, one site may have both,
since turns are short; of four, three."""


class FairGate:
    """Turns, a few at once.

    Of the sites that wait, the one with the fewest turns at the moment goes first, then the one
    that has used least lately; of its tokens the same. A site keeps one turn free for others
    where it has more than `may_take` allows.

    Parameters
    ----------
    count
        Turns at once.
    """

    def __init__(self, count: int, usage: DecayedUsage | None = None) -> None:
        self._count, self._usage = count, usage or DecayedUsage()
        self._waiting: dict[Holder, collections.deque[asyncio.Future[None]]] = {}
        self._running, self._total = Counter[Holder](), 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._turns: dict[asyncio.Task[Any] | None, tuple[Holder, float]] = {}

    async def __aenter__(self) -> None:
        """Wait for a turn."""
        self._turns[asyncio.current_task()] = await self.acquire(current_holder())

    async def __aexit__(self, *_: object) -> None:
        """End the turn."""
        self.release(*self._turns.pop(asyncio.current_task()))

    async def acquire(self, holder: Holder) -> tuple[Holder, float]:
        """Wait for a turn; return what `release` is given."""
        loop = asyncio.get_running_loop()
        if self._loop is not loop:  # of another server in this process, which has ended
            self._loop, self._waiting = loop, {}
            self._running, self._total, self._turns = Counter(), 0, {}
        begun = loop.create_future()
        self._waiting.setdefault(holder, collections.deque()).append(begun)
        self._begin()
        try:
            await begun
        except asyncio.CancelledError:
            if not begun.cancelled():  # its turn has come in the same moment
                self.release(holder, time.monotonic())
            raise
        return holder, time.monotonic()

    def release(self, holder: Holder, since_s: float) -> None:
        """End a turn that began at `since_s`."""
        self._usage.add(holder, time.monotonic() - since_s)
        self._running[holder] -= 1
        self._total -= 1
        self._running += Counter()  # forgets who has none
        self._begin()

    def _begin(self) -> None:
        while self._waiting and self._total < self._count:
            holder = min(self._waiting, key=self._rank)
            of_site = self._of_site(holder.site)
            free = self._count - self._total
            if holder != ALONE and of_site and not may_take(of_site, free, ALPHA):
                return
            waiting = self._waiting[holder]
            begun = waiting.popleft()
            if not waiting:
                del self._waiting[holder]
            if begun.cancelled():
                continue
            self._running[holder] += 1
            self._total += 1
            begun.set_result(None)

    def _rank(self, holder: Holder) -> tuple[float, ...]:
        site, token = self._usage.rank(holder)
        return self._of_site(holder.site), site, self._running[holder], token

    def _of_site(self, site: str) -> int:
        return sum(count for holder, count in self._running.items() if holder.site == site)
