"""Registrations are announced in turn, at a rate that does not grow with the fleet."""

import collections
import types
from typing import Any

import pytest

from slowtime_schemas.streams import REGISTRATION
from slowtime_services.clock import SystemClock
from twin_server.pipeline.ingestion import state_publisher
from twin_server.pipeline.ingestion.estimation import new_twin
from twin_server.pipeline.ingestion.state_publisher import StatePublisher
from twin_server.registration.twin import Registration

ELECTED = types.SimpleNamespace(first=None)
OTHER_IS_FIRST = types.SimpleNamespace(first="another server")


class Kept:
    """A bus that keeps the keys of what is published."""

    def __init__(self):
        self.keys = []

    def publish(self, key, payload, *, encoding):
        self.keys.append(key)


@pytest.fixture
def announced(monkeypatch):
    """Return the keys announced in each half second of some time, of so many twins."""

    def announce(twins, seconds, election=ELECTED):
        bus: Any = Kept()
        nothing_owed: Any = None
        counts = collections.Counter[str]()
        publisher = StatePublisher(bus, SystemClock(), counts, 100, election, nothing_owed)
        twin = new_twin(Registration())
        fleet = {("lab", f"a{number}"): twin for number in range(twins)}
        steps = []
        for step in range(2 * seconds + 1):
            hand = types.SimpleNamespace(monotonic=lambda step=step: 1000.0 + step / 2)
            monkeypatch.setattr(state_publisher, "time", hand)
            publisher.announce_all(fleet)
            steps.append(bus.keys)
            bus.keys = []
        return steps

    return announce


def test_a_small_fleet_is_announced_at_once_and_then_every_ten_seconds(announced):
    first, *later = announced(20, 100)
    assert set(first) == {REGISTRATION.key("lab", f"a{number}") for number in range(20)}
    told = collections.Counter(key for keys in later for key in keys)
    assert set(told.values()) <= {9, 10, 11}
    assert max(map(len, later)) == 1


def test_a_large_fleet_is_announced_in_turn_a_hundred_a_second(announced):
    steps = announced(5000, 49)
    assert max(map(len, steps)) == 100
    told = collections.Counter(key for keys in steps for key in keys)
    assert len(told) == 5000
    assert set(told.values()) == {1}


def test_a_server_that_is_not_the_first_announces_nothing(announced):
    assert not any(announced(20, 20, OTHER_IS_FIRST))
