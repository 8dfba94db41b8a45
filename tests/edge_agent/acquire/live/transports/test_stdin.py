"""Bytes of a pipe come as they are written, until its writer ends."""

import os
import threading

import pytest

from edge_agent.acquire.live.transports import stdin
from edge_agent.acquire.live.transports.stdin import StandardInput
from slowtime_services.clock import HandClock


@pytest.fixture
def pipe(monkeypatch):
    monkeypatch.setattr(stdin, "POLL_S", 0.01)
    reads, writes = os.pipe()
    yield reads, writes
    os.close(reads)


def test_written_bytes_come_with_their_time_and_the_end_of_the_writer_ends_it(pipe):
    reads, writes = pipe
    clock = HandClock(1_000)
    packets = StandardInput(clock, reads).packets(threading.Event())
    os.write(writes, b"1,2\n")
    first = next(packets)
    assert first is not None
    assert (first.data, first.arrival_ns) == (b"1,2\n", 1_000)
    os.write(writes, b"3,")
    os.write(writes, b"4\n")
    os.close(writes)
    rest = list(packets)
    assert b"".join(packet.data for packet in rest if packet is not None) == b"3,4\n"


def test_silence_gives_none_and_is_no_end(pipe):
    reads, writes = pipe
    packets = StandardInput(HandClock(0), reads).packets(threading.Event())
    assert next(packets) is None
    assert next(packets) is None
    os.write(writes, b"later")
    after = next(packets)
    assert after is not None
    assert after.data == b"later"
    os.close(writes)


def test_a_silent_pipe_can_be_stopped(pipe):
    reads, writes = pipe
    stop = threading.Event()
    packets = StandardInput(HandClock(0), reads).packets(stop)
    assert next(packets) is None
    stop.set()
    assert list(packets) == []
    os.close(writes)
