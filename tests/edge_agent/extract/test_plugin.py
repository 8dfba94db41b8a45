"""What an identifier or a source of one's own does wrong costs its window, or its packets."""

import dataclasses
import logging
import threading
import time

import numpy as np
import pytest

from edge_agent.acquire.live.registry import TransportContext, scheme_of
from edge_agent.acquire.live.transports import plugin as source
from edge_agent.extract import plugin
from edge_agent.extract.reader import Memory, Window
from edge_agent.inputs import LiveInput
from edge_agent.settings import ExtractSettings
from slowtime.signals.block import RateCorrection
from slowtime_services.clock import SystemClock
from slowtime_services.plugins import PluginError
from tests.edge_agent.acquire.live.listening import opened as opened_live
from tests.services.plugins.test_plugins import installed as installed

WINDOW = Window(np.zeros((8, 1)), 100.0, ("a",), 0.0)
GOOD = [
    {"frequency_hz": {"value": 4.0, "sd": 0.1}, "damping_ratio": {"value": 0.01, "sd": 0.01}}
]


class Answers:
    """A part in the place of its process."""

    def __init__(self, answer):
        self.answer = answer

    def ask(self, *given, timeout_s):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "why", "modes"),
    [
        (GOOD, ("own_identifier",), 1),
        ([], ("no_mode",), 0),
        (None, ("no_mode",), 0),
        (PluginError("it did not answer"), ("failed",), 0),
        ([{"frequency_hz": "high"}], ("not_credible",), 0),
        ({"frequency_hz": 4.0}, ("not_credible",), 0),
        ([{**GOOD[0], "frequency_hz": {"value": -4.0, "sd": 0.1}}], ("not_credible",), 0),
        ([{**GOOD[0], "frequency_hz": {"value": None, "sd": 0.1}}], ("not_credible",), 0),
    ],
)
def test_whatever_a_part_answers_the_window_is_read_or_says_why(
    answer, why, modes, installed, monkeypatch, caplog
):
    installed("identifiers")
    monkeypatch.setattr(plugin, "_process", lambda name: Answers(answer))
    with caplog.at_level(logging.ERROR):
        step = plugin.PluginIdentifier(ExtractSettings(identifier="own"), "own").step
        _, reading = step(Memory(), WINDOW)
    assert (reading.why + reading.doubts, len(reading.modes)) == (why, modes)
    if why == ("not_credible",):
        assert "of bad-parts 1.0 gave no modes" in caplog.text


def test_the_error_of_the_clock_is_added_to_what_a_part_says(installed, monkeypatch):
    installed("identifiers")
    monkeypatch.setattr(plugin, "_process", lambda name: Answers(GOOD * 2))
    window = dataclasses.replace(WINDOW, clock=RateCorrection(relative=0.0, sd=0.1))
    _, reading = plugin.PluginIdentifier(ExtractSettings(identifier="own"), "own").step(
        Memory(), window
    )
    expected = np.hypot(0.1, 4.0 * 0.1)
    assert [mode.frequency_hz.sd for mode in reading.modes] == pytest.approx([expected] * 2)
    assert reading.doubts == ("own_identifier", "clock_uncertain")


def test_a_source_is_a_scheme_by_its_name(installed):
    installed("sources", "own", "bad_parts:packets")
    live = LiveInput.of("own:?layout=csv&channels=a&rate_hz=100&anything=1")
    assert scheme_of(live.source).says == "of bad-parts 1.0"
    opened = source.opened(live, TransportContext(SystemClock()))
    given = list(opened.transport.packets(threading.Event()))
    assert [packet.data for packet in given if packet] == [b"one", b"two"]


def test_a_scheme_that_nobody_brings_is_told_with_those_that_are_there(installed):
    installed("sources", "own")
    with pytest.raises(ValueError, match=r"has the scheme 'onw'. Allowed: .*opcua, own;"):
        scheme_of("onw:")


def counted(live, wanted, stop):
    """Run a source until its counters say enough; the counters."""
    opened = opened_live(live, stop)
    thread = threading.Thread(target=lambda: list(opened), daemon=True)
    thread.start()
    deadline = time.monotonic() + 60
    while not wanted(opened.counts()) and time.monotonic() < deadline:
        time.sleep(0.05)
    stop.set()
    thread.join(30)
    assert not thread.is_alive()
    return opened.counts()


@pytest.mark.parametrize("target", ["hangs", "some_then_hangs", "ends", "some_then_raises"])
def test_a_source_that_hangs_or_ends_is_started_again_and_counted(installed, target, caplog):
    """Each time of at least three, after a pause that grows; the agent goes on."""
    installed("sources", "own", f"bad_parts:{target}")
    live = LiveInput.of("own:?layout=csv&channels=a&rate_hz=100", silent_after_s=0.2)
    counts = counted(live, lambda now: now["source_restarts"] >= 3, threading.Event())
    assert counts["source_restarts"] >= 3
    assert counts["sensor_silences"] >= 1
    if "hangs" in target:
        assert (
            "yielded nothing for 0.6 s (3 times silent_after_s), and was ended" in caplog.text
        )


def test_a_part_that_sends_a_little_and_ends_each_time_is_not_started_at_once_for_ever(
    installed, monkeypatch
):
    installed("sources", "own", "bad_parts:some_then_raises")
    monkeypatch.setattr(source.PluginPackets, "pauses_s", (0.01, 600.0))
    live = LiveInput.of("own:?layout=csv&channels=a&rate_hz=100")
    stop = threading.Event()
    threading.Timer(8.0, stop.set).start()
    assert counted(live, lambda now: stop.is_set(), stop)["source_restarts"] == 2


def test_a_source_that_sends_is_never_taken_to_hang(installed):
    installed("sources", "own", "bad_parts:slowly")
    live = LiveInput.of("own:?layout=csv&channels=a&rate_hz=100", silent_after_s=1.0)
    counts = counted(live, lambda now: now["samples_received"] >= 12, threading.Event())
    assert counts["source_restarts"] == 0
