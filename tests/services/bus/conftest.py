"""Both members of the family of buses, each with a way to make a second process of it."""

import dataclasses
from collections.abc import Callable

import pytest

from slowtime_services.bus import Bus, MemoryBus, ZenohBus


@dataclasses.dataclass
class Pair:
    """Two buses of one network, as two processes would have them."""

    one: Bus
    other: Bus
    join: Callable[[], Bus]


@pytest.fixture(params=["memory", "client-client", "peer-client", "client-peer"])
def pair(request, endpoint, eventually):
    """Every way two processes of the house may be joined."""
    opened = []

    def keep(bus):
        opened.append(bus)
        return bus

    if request.param == "memory":
        first = keep(MemoryBus())
        yield Pair(first, keep(MemoryBus(joins=first)), lambda: keep(MemoryBus(joins=first)))
    else:
        modes = request.param.split("-")
        one, other = (keep(ZenohBus(mode, connect=[endpoint])) for mode in modes)
        assert eventually(lambda: one.connected and other.connected)
        yield Pair(one, other, lambda: keep(ZenohBus(modes[1], connect=[endpoint])))
    for bus in opened:
        bus.close()
