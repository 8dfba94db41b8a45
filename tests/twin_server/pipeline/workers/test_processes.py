"""Processes that compute: they give what the function gives, are ended, and are replaced."""

import contextlib
import contextvars
import math
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from twin_server.fairness import Holder, Processors, acting_for
from twin_server.pipeline import WorkerProcesses
from twin_server.pipeline.workers.processes import AbandonedError
from twin_server.serve import ProblemError
from twin_server.serve.http import compute_queue

PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def workers():
    made = WorkerProcesses(1, PATIENCE_S)
    yield made
    made.close()


def test_it_gives_what_the_function_gives_or_raises_what_it_raises(workers):
    assert workers.run(math.hypot, 3.0, 4.0) == 5.0
    with pytest.raises(ValueError, match="math domain error"):
        workers.run(math.sqrt, -1.0)
    assert workers.run(os.getpid) == workers.run(os.getpid) != os.getpid()


def test_one_that_dies_is_said_to_have_and_is_replaced(workers):
    with pytest.raises(ProblemError, match="died") as refused:
        workers.run(os._exit, 3)
    assert refused.value.status == 503
    before = workers.run(os.getpid)
    os.kill(before, signal.SIGKILL)
    with contextlib.suppress(ProblemError):  # it may not be dead yet
        workers.run(os.getpid)
    assert workers.run(math.hypot, 3.0, 4.0) == 5.0


def test_what_takes_too_long_is_ended():
    workers = WorkerProcesses(1, 0.2)
    with pytest.raises(ProblemError, match=r"ended after 0\.2 s.*Ask for less"):
        workers.run(time.sleep, 600.0)
    workers.close()
    with pytest.raises(ProblemError, match="ending"):
        workers.run(os.getpid)


def test_what_nobody_waits_for_is_ended(workers):
    left = threading.Event()

    def asked():
        compute_queue._abandoned.set(left)
        with pytest.raises(AbandonedError):
            workers.run(time.sleep, 600.0)

    with ThreadPoolExecutor(1) as pool:
        asking = pool.submit(contextvars.Context().run, asked)
        left.set()
        asking.result(PATIENCE_S)
    assert workers.run(math.hypot, 3.0, 4.0) == 5.0


def test_it_computes_after_others(workers):
    assert workers.run(os.nice, 0) >= 10


def test_one_is_paused_for_a_site_that_has_used_less_and_pauses_are_not_counted():
    processors = Processors(1)
    processors.usage.add(Holder("greedy", "t"), 1_000.0)
    workers = WorkerProcesses(2, 2.0, processors)
    before_s = time.monotonic()

    def asked(site, function, *arguments):
        with acting_for(Holder(site, "t")):
            return workers.run(function, *arguments)

    with ThreadPoolExecutor(2) as threads:
        greedy = threads.submit(asked, "greedy", _work_s, 0.5)
        while not processors._turns:
            time.sleep(0.01)
        # Longer than the one that is paused may take.
        modest = [threads.submit(asked, "modest", time.sleep, 1.5) for _ in range(2)]
        assert all(one.result(PATIENCE_S) is None for one in modest)
        assert greedy.result(PATIENCE_S) < PATIENCE_S
    assert time.monotonic() - before_s > 3.0
    workers.close()


def _work_s(seconds):
    """Use the processor for so long; seconds by the clock."""
    began_s, began = time.monotonic(), time.process_time()
    while time.process_time() - began < seconds:
        pass
    return time.monotonic() - began_s
