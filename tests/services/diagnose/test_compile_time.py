import threading
import time

import numba
import pytest

from slowtime_services.diagnose.compile_time import compiling_s


def fresh():
    """Give a function that was never compiled, which calls another."""

    @numba.njit
    def inner(x):
        return x * x

    @numba.njit
    def outer(x):
        return inner(x) + 1.0

    return outer


def test_what_is_compiled_is_timed_once_and_what_runs_is_not():
    function = fresh()
    before, begun = compiling_s(), time.thread_time()
    assert function(3.0) == 10.0
    spent = compiling_s() - before
    assert 0 < spent <= time.thread_time() - begun
    assert spent == pytest.approx(time.thread_time() - begun, rel=0.3)
    before = compiling_s()
    for _ in range(1000):
        function(3.0)
    assert compiling_s() == before


def test_each_thread_counts_its_own():
    before, others = compiling_s(), []

    def elsewhere():
        others.append(compiling_s())
        fresh()(2.0)
        others.append(compiling_s())

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert others[0] == 0.0
    assert others[1] > 0
    assert compiling_s() == before
