"""Runs functions that compute for long in processes that can be ended.

A thread that computes would keep the interpreter from the event loop and from the features that
arrive. The processes are forked from one that has loaded all they need, so that one which was
ended, since nobody waits any more or it takes too long, is replaced at once.
"""

import contextlib
import multiprocessing
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any, Protocol, TypeVar

from slowtime_services.operating_system import (
    end_with_parent,
    lower_priority,
    pause_process,
    resume_process,
)
from twin_server.fairness import Processors, Turn, current_holder
from twin_server.serve import ProblemError
from twin_server.serve.http.compute_queue import abandoned

T = TypeVar("T")

LOADED = "twin_server.pipeline.workers.preload"
"""Module that the processes have loaded before they are there."""

LOOK_S = 0.05
"""How often it is looked whether anybody still waits."""

NICENESS = 10
"""Of the processes, so that requests and features come first."""

WARMED = "SLOWTIME_WORKERS_ARE_WARMED"
"""Set where what the processes have loaded shall also be compiled."""

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class AbandonedError(Exception):
    """The caller no longer waits for the result."""


class WorkerPool(Protocol):
    """Runs functions, here or in other processes."""

    def run(self, function: Callable[..., T], /, *arguments: Any) -> T:
        """Return the result of a function, or raise its exception."""
        ...

    def close(self) -> None:
        """Compute nothing more."""
        ...


class CallerThread:
    """The thread that asks."""

    def run(self, function: Callable[..., T], /, *arguments: Any) -> T:
        """Return the result of a function."""
        return function(*arguments)

    def close(self) -> None:
        """Do nothing."""


class WorkerProcesses:
    """Processes that compute, one call each at a time.

    Parameters
    ----------
    count
        How many.
    timeout_s
        How long one call may take until it is ended; pauses in favour of others not counted.
    processors
        Pause them in favour of other sites.
    """

    def __init__(
        self, count: int, timeout_s: float, processors: Processors | None = None
    ) -> None:
        self._timeout_s, self._processors = timeout_s, processors or Processors()
        self._free: queue.SimpleQueue[_Worker | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._all: set[_Worker] = set()
        self._closed = False
        self._context = _context()
        for _ in range(count):
            self._free.put(None)

    def warm(self) -> None:
        """Load required code in the background, so the first request does not wait for it."""
        threading.Thread(target=self._warm, name="warm", daemon=True).start()

    def run(self, function: Callable[..., T], /, *arguments: Any) -> T:
        """Return the result of a function; function and arguments are pickled.

        Raises
        ------
        AbandonedError
            Where nobody waits any more.
        ProblemError
            503 where it takes too long, or its process dies.
        """
        worker = self._free.get()
        try:
            if worker is None or not worker.alive:
                worker = self._begin()
            with self._processors.turn(current_holder(), worker.pause, worker.resume) as turn:
                worker.send(function, arguments)
                self._await(worker, turn)
                sound, answer = worker.receive()
        except BaseException as error:
            if worker is not None:
                self._end(worker)
            worker = None
            if isinstance(error, (EOFError, OSError)):
                raise _ended("The process that computed it died.") from error
            raise
        finally:
            self._free.put(worker)
        if sound:
            return answer  # type: ignore[no-any-return]
        raise answer

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            self._closed = True
            workers = list(self._all)
        for worker in workers:
            self._end(worker)

    def _warm(self) -> None:
        with contextlib.suppress(Exception):
            self.run(os.getpid)

    def _begin(self) -> "_Worker":
        if self._closed:
            raise _ended("The server is ending.")
        # Without the lock: what the first one waits for is loaded for seconds.
        worker = _Worker(self._context)
        if not self._register(worker):
            worker.kill()
            raise _ended("The server is ending.")
        return worker

    def _register(self, worker: "_Worker") -> bool:
        """Register a process, unless all have been ended meanwhile."""
        with self._lock:
            if not self._closed:
                self._all.add(worker)
            return not self._closed

    def _end(self, worker: "_Worker") -> None:
        with self._lock:
            self._all.discard(worker)
        worker.kill()

    def _await(self, worker: "_Worker", turn: Turn) -> None:
        while not worker.answered(LOOK_S):
            if abandoned():
                raise AbandonedError
            if turn.running_s() > self._timeout_s:
                raise _ended(
                    f"It was ended after {self._timeout_s:g} s (serve.work_timeout_s). Ask for "
                    "less at once."
                )


class _Worker:
    """One process."""

    def __init__(self, context: Any) -> None:
        ours, theirs = context.Pipe()
        self._pipe: Connection = ours
        self._process = context.Process(target=_work, args=(theirs,), name="work", daemon=True)
        with _one_thread():
            self._process.start()
        theirs.close()

    @property
    def alive(self) -> bool:
        # A pipe that has something to say before it was asked has come to its end.
        return bool(self._process.is_alive()) and not self._pipe.poll(0)

    def send(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self._pipe.send((function, arguments))

    def answered(self, patience_s: float) -> bool:
        """Wait a little for the answer, or for the end of the process."""
        return bool(self._pipe.poll(patience_s))

    def receive(self) -> tuple[bool, Any]:
        found: tuple[bool, Any] = self._pipe.recv()
        return found

    def pause(self) -> None:
        if self._process.pid is not None:
            pause_process(self._process.pid)

    def resume(self) -> None:
        if self._process.pid is not None:
            resume_process(self._process.pid)

    def kill(self) -> None:
        self._pipe.close()
        self._process.kill()
        self._process.join(10.0)


def _work(pipe: Connection) -> None:
    """Run functions that arrive, until the server ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    lower_priority(NICENESS)
    while True:
        try:
            function, arguments = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, function(*arguments)
        except Exception as error:
            answer = False, error
        try:
            pipe.send(answer)
        except (BrokenPipeError, ConnectionError):
            return
        except Exception as error:  # what cannot be pickled is told in words
            pipe.send(
                (False, RuntimeError(f"{type(answer[1]).__name__}: {answer[1]} ({error})"))
            )


def _context() -> Any:
    """Return a context that forks from a process with all code loaded, if fork is available."""
    if sys.platform == "win32":  # pragma: no cover
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([LOADED])
    return context


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Limit linear algebra of new processes to one thread, as processors are few."""
    lacking = [name for name in (*_ONE_THREAD, WARMED) if name not in os.environ]
    os.environ.update(dict.fromkeys(lacking, "1"))
    try:
        yield
    finally:
        for name in lacking:
            os.environ.pop(name, None)


def _ended(why: str) -> ProblemError:
    return ProblemError(503, "not-computed", f"{why} Try again later.", **{"Retry-After": "5"})
