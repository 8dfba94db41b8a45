"""A source of one's own: packets that an installed part yields in a process of its own."""

import threading
from collections.abc import Iterator

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, Surroundings, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock
from slowtime_services.plugin_process import PluginProcess
from slowtime_services.plugins import find

GROUP = "slowtime.sources"


class OwnPackets:
    """Whatever the part does, packets come or do not come; the agent reconnects."""

    is_stream = ends = False

    def __init__(self, url: str, process: PluginProcess, clock: Clock) -> None:
        self._url, self._process, self._clock = url, process, clock

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Packets as the part yields them."""
        for data in self._process.stream(self._url, stop=stop):
            yield None if data is None else Packet(data, self._clock.now_ns())

    def close(self) -> None:
        """End the process of the part."""
        self._process.close()


def opened(settings: LiveInput, around: Surroundings) -> Opened:
    """Find the part; it is imported when it is first asked for packets."""
    process = PluginProcess(find(GROUP, settings.scheme))
    layout, rate_hz = declared(settings, settings.scheme)
    return Opened(OwnPackets(settings.source, process, around.clock), layout, rate_hz)
