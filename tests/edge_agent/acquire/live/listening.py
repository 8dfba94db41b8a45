"""Live sources as tests open them."""

import threading

from edge_agent.acquire import LiveSource, open_source
from edge_agent.inputs import LiveInput
from slowtime_services.bus import Bus
from slowtime_services.clock import SystemClock


def opened(live: LiveInput, stop: threading.Event, bus: Bus | None = None) -> LiveSource:
    """Open a live source of the asset `lab.beam`."""
    source = open_source(live, SystemClock(), stop, bus=bus, twin=("lab", "beam"))
    assert isinstance(source, LiveSource)
    return source
