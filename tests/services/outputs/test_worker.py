"""An output that fails is tried again, and delays nobody."""

import threading
import time

import pytest

from slowtime_services.outputs import NotSentError, Positions
from slowtime_services.outputs.history_reader import HistoryReader
from slowtime_services.outputs.worker import OutputWorker
from tests.services.outputs.conftest import state


class Receiver:
    """Takes batches; fails as often as it is told, in the way it is told."""

    is_archive = True

    def __init__(self, *failures):
        self.failures, self.taken, self.starts, self.closes = list(failures), [], 0, 0

    def start(self):
        self.starts += 1

    def send(self, batch):
        if self.failures:
            raise self.failures.pop(0)
        self.taken += [one.sequence for one in batch.states]

    def close(self):
        self.closes += 1


@pytest.fixture
def working(server, tmp_path):
    """Start a worker of a receiver; all are ended."""
    made: list[OutputWorker] = []

    def start(receiver, **more):
        positions = Positions(tmp_path / f"{len(made)}.json")
        reader = HistoryReader(
            server, positions, lambda _: True, from_beginning=True, is_archive=True
        )
        settings = {"every_s": 0.01, "backoff_s": 0.01, "max_backoff_s": 0.05} | more
        made.append(OutputWorker("a", receiver, reader, positions, **settings))
        made[-1].start()
        return made[-1]

    yield start
    for one in made:
        one.stop(5.0)


def test_failures_are_tried_again_and_said_once(server, working, eventually, caplog):
    caplog.set_level("INFO")
    server.states = [state(n) for n in range(3)]
    receiver = Receiver(*[NotSentError("It is away.") for _ in range(5)], ZeroDivisionError())
    working(receiver)
    assert eventually(lambda: receiver.taken == [0, 1, 2])
    assert receiver.starts == 7
    assert caplog.text.count("It is away.") == 1
    assert eventually(lambda: caplog.text.count("sends again") == 1)


def test_a_wait_that_a_receiver_asks_for_is_kept(server, working, eventually):
    server.states = [state(0)]
    receiver = Receiver(NotSentError("It is busy.", 0.5))
    began_s = time.monotonic()
    working(receiver)
    assert eventually(lambda: receiver.taken == [0])
    assert time.monotonic() - began_s >= 0.5


def test_a_refusal_waits_for_the_longest_pause(server, working, eventually):
    server.states = [state(0)]
    receiver = Receiver(NotSentError("No such bucket.", is_refused=True))
    began_s = time.monotonic()
    working(receiver, max_backoff_s=0.5)
    assert eventually(lambda: receiver.taken == [0])
    assert time.monotonic() - began_s >= 0.5


def test_a_receiver_that_hangs_keeps_no_other_and_no_end_waiting(server, working, eventually):
    server.states = [state(0)]
    released = threading.Event()

    class Hanging(Receiver):
        def send(self, batch):
            released.wait(60)

    hanging, other = working(Hanging()), Receiver()
    working(other)
    assert eventually(lambda: other.taken == [0])
    began_s = time.monotonic()
    hanging.stop(0.2)
    assert time.monotonic() - began_s < 5.0
    released.set()
