"""Queues requests that compute, with a bounded length, apart from all others.

What is asked twice at once is computed once. A line that is full is said to be, with 503 and
`Retry-After`, before anything is computed. Who leaves the line is forgotten, and what nobody
waits for any more is ended (`abandoned`).
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

from .problems import ProblemError

T = TypeVar("T")

RETRY_AFTER_S = 5
"""What a client is told to wait where the line is full: about what one turn takes."""

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
class _Job:
    """A computation, and the number of requests that wait for it.

    Parameters
    ----------
    group
        Of which one is computed at a time.
    share
        Equal where the answers are.
    light
        Whether it goes before others.
    """

    group: object
    share: object
    light: bool
    work: Callable[[], Any]
    loop: asyncio.AbstractEventLoop
    future: asyncio.Future[Any]
    ended: threading.Event = dataclasses.field(default_factory=threading.Event)
    waiting: int = 0
    running: bool = False

    def execute(self) -> Any:
        """Compute, in a thread of the lane."""
        token = _abandoned.set(self.ended)
        try:
            return self.work()
        finally:
            _abandoned.reset(token)


class ComputeQueue:
    """Some threads, and the requests that wait for them; used in the event loop.

    Parameters
    ----------
    workers
        Requests that are computed at once. One of them is kept free of what is not `light`,
        where there are several.
    longest, longest_of_one
        Most that wait, in all and of one group.
    """

    def __init__(self, workers: int, longest: int, longest_of_one: int) -> None:
        self._workers, self._longest, self._of_one = workers, longest, longest_of_one
        self._threads = concurrent.futures.ThreadPoolExecutor(workers, "work")
        self._jobs: list[_Job] = []
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
            503 where too many wait already.
        ClientDisconnect
            Where the client disconnected.
        """
        job = self._find_or_enqueue(work, group, share, light)
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
        self, work: Callable[[], Any], group: object, share: object, light: bool
    ) -> _Job:
        for job in self._jobs:
            if share is not None and job.share == share and not job.ended.is_set():
                self.counts["shared"] += 1
                return job
        of_group = sum(job.group == group and not job.running for job in self._jobs)
        if of_group >= self._of_one or self.waiting >= self._longest:
            self.counts["refused"] += 1
            raise ProblemError(
                503,
                "busy",
                f"Too many requests wait to be computed. Allowed: {self._longest}, of one kind "
                f"{self._of_one} (serve.max_waiting, serve.max_waiting_of_one). Try again in "
                f"{RETRY_AFTER_S} s.",
                **{"Retry-After": str(RETRY_AFTER_S)},
            )
        loop = asyncio.get_running_loop()
        job = _Job(group, share, light, work, loop, loop.create_future())
        self._jobs.append(job)
        self._begin_next()
        return job

    def _begin_next(self) -> None:
        """Begin whatever may run: light ones first, of each group one, one place kept free."""
        for job in sorted(self._jobs, key=lambda job: not job.light):
            others = [other for other in self._jobs if other.running]
            if job.running or len(others) >= self._workers:
                continue
            heavy = sum(not other.light for other in others)
            if not job.light and heavy >= max(1, self._workers - 1):
                continue
            if any(other.group == job.group for other in others):
                continue
            job.running = True
            self.counts["begun"] += 1
            begun = self._threads.submit(job.execute)
            begun.add_done_callback(lambda begun, job=job: self._tell(job, begun))  # type: ignore[misc]

    def _tell(self, job: _Job, begun: concurrent.futures.Future[Any]) -> None:
        """Pass on the result of a thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            job.loop.call_soon_threadsafe(self._end, job, begun)

    def _end(self, job: _Job, begun: concurrent.futures.Future[Any]) -> None:
        if job in self._jobs:
            self._jobs.remove(job)
        if not job.future.done():
            if begun.cancelled():
                job.future.cancel()
            elif (error := begun.exception()) is not None:
                job.future.set_exception(error)
                job.future.exception()  # nobody may be left to look at it
            else:
                job.future.set_result(begun.result())
        self._begin_next()

    def _leave(self, job: _Job) -> None:
        """Drop computations without a waiting caller."""
        job.ended.set()
        if not job.running and job in self._jobs:
            self._jobs.remove(job)


async def _gone(request: Request) -> None:
    """Wait until the client leaves."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
