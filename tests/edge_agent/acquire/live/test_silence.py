"""A sensor that sends nothing is told, whatever happens to the machine's clock."""

import itertools
import threading
import time

from edge_agent.acquire.live import sensor
from edge_agent.inputs import LiveInput

from .listening import opened
from .test_sources import LINES, free_port


def test_silence_is_told_after_the_clock_has_been_set_back(monkeypatch):
    stop = threading.Event()
    passed_s = itertools.count()

    def monotonic():
        now_s = next(passed_s)
        if now_s >= 12:
            stop.set()
        return float(now_s)

    monkeypatch.setattr(sensor, "monotonic", monotonic, raising=False)
    live = LiveInput.of(f"udp://127.0.0.1:{free_port()}?{LINES}", silent_after_s=5.0)
    source = opened(live, stop)
    began_ns = time.time_ns()
    monkeypatch.setattr(time, "time_ns", lambda: began_ns - 3600 * 10**9)
    guard = threading.Timer(10.0, stop.set)
    guard.start()
    assert list(source) == []
    guard.cancel()
    counts = source.counts()
    assert counts["sensor_silences"] == 1
    assert counts["sensor_silent_s"] >= 5
