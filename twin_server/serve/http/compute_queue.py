"""Queues requests that compute, with a bounded length, apart from all others.

What is asked twice at once is computed once. A line that is full is said to be, with 503 and
`Retry-After`, before anything is computed; so is a site's part of it, with 429. Who leaves the
line is forgotten, and what nobody waits for any more is ended (`abandoned`). Of the sites that
wait, the one that has used least lately goes first; one of which nothing is computed is not
kept waiting by others that have all threads.
"""

import asyncio
import concurrent.futures
import contextlib
import contextvars
import dataclasses
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect, Request

from twin_server.fairness import (
    DecayedUsage,
    Holder,
    OverQuotaError,
    Quota,
    QuotaHolding,
    acting_for,
    current_holder,
)

from .problems import ProblemError
from .quotas import cancelled_error, over_quota

T = TypeVar("T")

RETRY_AFTER_S = 5
"""What a client is told to wait where the line is full: about what one turn takes."""

JOB_S = 0.05
"""Time of the server that a computation is counted for beside that of its process [s]."""

WAYS = ("begun", "shared", "refused", "abandoned")
"""What becomes of requests: computed, answered with another's answer, refused, left."""

_abandoned: contextvars.ContextVar[threading.Event | None] = contextvars.ContextVar(
    "abandoned", default=None
)


def abandoned() -> bool:
    """Whether no caller waits for the computation of this thread."""
    event = _abandoned.get()
    return event is not None and event.is_set()


@dataclasses.dataclass(slots=True, eq=False)
class _Computation:
    """A computation, and the number of requests that wait for it.

    Parameters
    ----------
    holder
        For whom it is computed.
    group
        Of which one is computed at a time, of each site.
    share
        Equal where the answers are.
    light
        Whether it goes before others.
    """

    holder: Holder
    group: object
    share: object
    light: bool
    work: Callable[[], Any]
    loop: asyncio.AbstractEventLoop
    future: asyncio.Future[Any]
    ended: threading.Event = dataclasses.field(default_factory=threading.Event)
    waiting: int = 0
    running: bool = False
    holding: QuotaHolding | None = None

    def execute(self) -> Any:
        """Compute, in a thread of the lane."""
        token = _abandoned.set(self.ended)
        try:
            with acting_for(self.holder):
                return self.work()
        finally:
            _abandoned.reset(token)


class ComputeQueue:
    """Some threads, and the requests that wait for them; used in the event loop.

    Parameters
    ----------
    workers
        Requests of one site that are computed at once. One of them is kept free of what is not
        `light`, where there are several.
    longest, longest_of_one
        Most that wait or are computed, in all and of one group of a site.
    spare
        Further threads, each for a site of which nothing is computed while others have all.
    usage
        What each site has used.
    """

    def __init__(
        self,
        workers: int,
        longest: int,
        longest_of_one: int,
        spare: int = 0,
        usage: DecayedUsage | None = None,
    ) -> None:
        self._workers, self._longest, self._of_one = workers, longest, longest_of_one
        self._spare, self._usage = spare, usage or DecayedUsage()
        self.quota = Quota("computations", longest + workers, setting="serve.max_waiting")
        self._threads = concurrent.futures.ThreadPoolExecutor(workers + spare, "work")
        self._jobs: list[_Computation] = []
        self.counts: Counter[str] = Counter()

    @property
    def waiting(self) -> int:
        """Number of waiting computations."""
        return sum(not job.running for job in self._jobs)

    @property
    def running(self) -> int:
        """Number of running computations."""
        return sum(job.running for job in self._jobs)

    async def run(
        self,
        request: Request,
        work: Callable[[], T],
        *,
        group: object,
        share: object = None,
        light: bool = False,
    ) -> T:
        """Wait for the answer, as long as the client does.

        Raises
        ------
        ProblemError
            503 where too many wait already or it was cancelled, 429 where too many of one site
            or token wait.
        ClientDisconnect
            Where the client disconnected.
        """
        what = f"{request.scope.get('method', '')} {request.scope.get('path', '')}"
        job = self._find_or_enqueue(work, group, share, light, what)
        job.waiting += 1
        gone = asyncio.ensure_future(_gone(request))
        try:
            await asyncio.wait({job.future, gone}, return_when=asyncio.FIRST_COMPLETED)
            if not job.future.done():
                self.counts["abandoned"] += 1
                raise ClientDisconnect
            answer: T = job.future.result()
            return answer
        finally:
            gone.cancel()
            job.waiting -= 1
            if not job.waiting:
                self._leave(job)

    def close(self) -> None:
        """Compute nothing more."""
        for job in list(self._jobs):
            job.ended.set()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _find_or_enqueue(
        self, work: Callable[[], Any], group: object, share: object, light: bool, what: str
    ) -> _Computation:
        for job in self._jobs:
            if share is not None and job.share == share and not job.ended.is_set():
                self.counts["shared"] += 1
                return job
        holder = current_holder()
        alike = [
            job
            for job in self._jobs
            if not job.running and job.group == group and job.holder.site == holder.site
        ]
        if len(alike) >= self._of_one:
            self.counts["refused"] += 1
            raise self._busy()
        loop = asyncio.get_running_loop()
        job = _Computation(holder, group, share, light, work, loop, loop.create_future())
        try:
            job.holding = self.quota.take(holder, what, lambda: self._cancel(job))
        except OverQuotaError as error:
            self.counts["refused"] += 1
            if error.own:
                raise over_quota(error, RETRY_AFTER_S) from error
            raise self._busy() from error
        self._jobs.append(job)
        self._begin_next()
        return job

    def _busy(self) -> ProblemError:
        return ProblemError(
            503,
            "busy",
            f"Too many requests wait to be computed. Allowed: {self._longest}, of one kind "
            f"{self._of_one} (serve.max_waiting, serve.max_waiting_of_one). Try again in "
            f"{RETRY_AFTER_S} s.",
            **{"Retry-After": str(RETRY_AFTER_S)},
        )

    def _begin_next(self) -> None:
        """Begin whatever may run, in the order of `_rank`."""
        while ready := [job for job in self._jobs if self._may_begin(job)]:
            job = min(ready, key=self._rank)
            job.running = True
            self.counts["begun"] += 1
            self._usage.add(job.holder, JOB_S)
            begun = self._threads.submit(job.execute)
            begun.add_done_callback(lambda begun, job=job: self._tell(job, begun))  # type: ignore[misc]

    def _rank(self, job: _Computation) -> tuple[float, ...]:
        """Return the place of a job: its site's, then its token's, then light ones first."""
        running = [other.holder for other in self._jobs if other.running]
        of_site = sum(holder.site == job.holder.site for holder in running)
        site, token = self._usage.rank(job.holder)
        return of_site, site, running.count(job.holder), token, not job.light

    def _may_begin(self, job: _Computation) -> bool:
        """Whether the threads, and the other jobs of its site, let a job begin."""
        running = [other for other in self._jobs if other.running]
        own = [other for other in running if other.holder.site == job.holder.site]
        if job.running or len(running) >= self._workers + (0 if own else self._spare):
            return False
        heavy = sum(not other.light for other in own)
        if not job.light and heavy >= max(1, self._workers - 1):
            return False
        return len(own) < self._workers and all(other.group != job.group for other in own)

    def _tell(self, job: _Computation, begun: concurrent.futures.Future[Any]) -> None:
        """Pass on the result of a thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            job.loop.call_soon_threadsafe(self._end, job, begun)

    def _end(self, job: _Computation, begun: concurrent.futures.Future[Any]) -> None:
        self._remove(job)
        if not job.future.done():
            if begun.cancelled():
                job.future.cancel()
            elif (error := begun.exception()) is not None:
                job.future.set_exception(error)
                job.future.exception()  # nobody may be left to look at it
            else:
                job.future.set_result(begun.result())
        self._begin_next()

    def _leave(self, job: _Computation) -> None:
        """Drop computations without a waiting caller."""
        job.ended.set()
        if not job.running:
            self._remove(job)

    def _cancel(self, job: _Computation) -> None:
        """End a computation for all who wait for it; in the event loop."""
        if not job.future.done():
            job.future.set_exception(cancelled_error())
            job.future.exception()  # nobody may be left to look at it
        self._leave(job)

    def _remove(self, job: _Computation) -> None:
        if job in self._jobs:
            self._jobs.remove(job)
        if job.holding is not None:
            job.holding.release()


async def _gone(request: Request) -> None:
    """Wait until the client leaves."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
