"""Connections are shut at their deadline, by one thread that comes and goes."""

import contextlib
import functools
import socket
import threading

import pytest

from twin_server.notify.deadlines import Deadlines

PATIENCE_S = 60.0


@pytest.fixture
def pair():
    """Two ends of a connection; reading from either gives up after a minute."""
    with contextlib.ExitStack() as stack:

        def made():
            ends = [stack.enter_context(end) for end in socket.socketpair()]
            for end in ends:
                end.settimeout(PATIENCE_S)
            return ends

        yield made


@pytest.fixture
def running():
    """The threads for deadlines that are not of before the test."""
    before = set(threading.enumerate())

    def found():
        more = [t for t in threading.enumerate() if t not in before]
        return [t for t in more if t.name == "notify-deadlines"]

    return found


def test_a_connection_is_shut_at_its_deadline(pair):
    here, there = pair()
    with Deadlines(idle_s=0.0).within(0.02, lambda: here):
        assert there.recv(1) == b""


def test_many_deadlines_are_kept_by_one_thread_the_nearest_first(pair, running):
    deadlines, order = Deadlines(idle_s=PATIENCE_S), []
    seconds = {0.06: pair(), 0.02: pair(), 0.04: pair()}

    def connected(time_s, here):
        order.append(time_s)
        return here

    with contextlib.ExitStack() as stack:
        for time_s, (here, _) in seconds.items():
            stack.enter_context(
                deadlines.within(time_s, functools.partial(connected, time_s, here))
            )
        assert len(running()) == 1
        assert [there.recv(1) for _, there in seconds.values()] == [b""] * 3
    assert order == sorted(seconds)


def test_a_block_that_ends_in_time_keeps_its_connection(pair):
    deadlines, (here, there), (other, far) = Deadlines(idle_s=0.0), pair(), pair()
    with deadlines.within(0.03, lambda: here):
        pass
    with deadlines.within(0.05, lambda: other):
        assert far.recv(1) == b""
    here.sendall(b"!")
    assert there.recv(1) == b"!"


def test_the_thread_ends_when_idle_and_starts_again_for_the_next(pair, running):
    deadlines = Deadlines(idle_s=0.0)
    for _ in range(2):
        here, there = pair()
        with deadlines.within(0.01, functools.partial(lambda end: end, here)):
            assert there.recv(1) == b""
        for thread in running():
            thread.join(PATIENCE_S)
        assert running() == []


def test_before_there_is_a_connection_nothing_is_shut(pair):
    deadlines, (here, there) = Deadlines(idle_s=0.0), pair()
    with deadlines.within(0.01, lambda: None), deadlines.within(0.02, lambda: here):
        assert there.recv(1) == b""
