"""Reads packets from an installed plug-in, in a process of its own."""

import contextlib
import threading
import time
from collections.abc import Iterator

from edge_agent.acquire.live.batch import Packet
from edge_agent.acquire.live.registry import Opened, TransportContext, declared
from edge_agent.inputs import LiveInput
from slowtime_services.clock import Clock
from slowtime_services.plugins.discovery import PluginError, find
from slowtime_services.plugins.plugin_process import PluginProcess

GROUP = "slowtime.sources"
HUNG_AFTER_SILENCES = 3
"""A part that yields nothing for so many `silent_after_s` hangs: its sensor was reported as
silent long before, and to start the part again costs nothing more."""


class PluginPackets:
    """Whatever the part does, packets come or do not come; it is started again."""

    is_stream = ends = False
    pauses_s = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 300.0)
    """A part that never works is started, and told of, some 300 times a day."""
    sound_s = 60.0

    def __init__(
        self, url: str, process: PluginProcess, clock: Clock, hung_after_s: float
    ) -> None:
        self._url, self._process, self._clock = url, process, clock
        self._hung_after_s = hung_after_s

    def packets(self, stop: threading.Event) -> Iterator[Packet | None]:
        """Packets as the part yields them.

        Raises `PluginError` where the part raised, ended its process, or hung and was ended.
        """
        heard_s = None
        # Closed here, not when it is collected: the part is ended before its next run.
        with contextlib.closing(self._process.stream(self._url, stop=stop)) as stream:
            for data in stream:
                now_s = time.monotonic()
                heard_s = now_s if heard_s is None or data is not None else heard_s
                if now_s - heard_s > self._hung_after_s:
                    raise PluginError(
                        f"{self._process.plugin} yielded nothing for {self._hung_after_s:g} s "
                        f"({HUNG_AFTER_SILENCES} times silent_after_s), and was ended"
                    )
                yield None if data is None else Packet(data, self._clock.now_ns())

    def close(self) -> None:
        """End the process of the part."""
        self._process.close()


def opened(settings: LiveInput, around: TransportContext) -> Opened:
    """Find the part; it is imported when it is first asked for packets."""
    process = PluginProcess(find(GROUP, settings.scheme))
    layout, rate_hz = declared(settings, settings.scheme)
    hung_after_s = HUNG_AFTER_SILENCES * settings.silent_after_s
    return Opened(
        PluginPackets(settings.source, process, around.clock, hung_after_s), layout, rate_hz
    )
