"""A bus on which only the messages of some assets arrive."""

import pytest

from slowtime_schemas.streams import FEATURES, HEALTH, alive_key, server_key
from slowtime_services.bus import MemoryBus, PartialBus
from slowtime_services.bus.key_versions import TwoVersionBus


def test_only_messages_of_its_assets_arrive():
    whole = MemoryBus()
    part = PartialBus(whole, lambda asset: asset == "beam")
    heard = []
    part.subscribe(FEATURES.everywhere, lambda sample: heard.append(sample.key))
    part.subscribe(HEALTH.everywhere, lambda sample: heard.append(sample.key))
    for stream in (FEATURES, HEALTH):
        for asset in ("beam", "fan"):
            whole.publish(stream.key("lab", asset), b"", encoding="x")
    assert heard == [FEATURES.key("lab", "beam"), HEALTH.key("lab", "beam")]


def test_only_its_edges_are_seen_and_all_servers():
    whole = MemoryBus()
    part = PartialBus(whole, lambda asset: asset == "beam")
    seen = []
    part.watch(alive_key("*", "*"), lambda key, alive: seen.append((key, alive)))
    part.watch(server_key("*"), lambda key, alive: seen.append((key, alive)))
    for asset in ("beam", "fan"):
        whole.announce(alive_key("lab", asset))
    whole.announce(server_key("fan"))
    assert seen == [(alive_key("lab", "beam"), True), (server_key("fan"), True)]


def test_what_is_sent_is_not_restricted():
    whole = MemoryBus()
    part = PartialBus(whole, lambda asset: False)
    heard = []
    whole.subscribe(FEATURES.everywhere, lambda sample: heard.append(sample.payload))
    part.publish(FEATURES.key("lab", "beam"), b"one", encoding="x")
    assert heard == [b"one"]


@pytest.mark.parametrize(
    "wrapped", [TwoVersionBus, lambda bus: PartialBus(bus, lambda asset: True)]
)
def test_a_lost_connection_is_seen_through_the_bus_around_it(wrapped):
    class Lost(MemoryBus):
        connected = False

    assert wrapped(MemoryBus()).connected
    assert not wrapped(Lost()).connected
