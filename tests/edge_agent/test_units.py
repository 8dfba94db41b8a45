"""Units go with the samples from where they are known to the features that are sent."""

import threading

import numpy as np
import pytest

from edge_agent.acquire import open_source
from edge_agent.extract import Extract
from edge_agent.extract.reader import ModeReading
from edge_agent.inputs import LiveInput
from edge_agent.publish.publisher import raw_message
from edge_agent.settings import ExtractSettings, Origin, RecordingInput
from slowtime.signals.block import Block
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import SensorSamples
from slowtime_schemas.raw import encode_raw
from slowtime_schemas.streams import RAW, SAMPLES
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import SystemClock
from slowtime_services.files import RecordError
from slowtime_services.record.writer import RecordingWriter

from .acquire.live.listening import opened

ORIGIN = Origin(site="lab", asset="beam", boot="b1")
UNITS = ("g", "mm/s", "mV", "1")
NAMES = ("a", "v", "u", "w")


def heard(live):
    """First block of a sensor on the bus that counts up in all channels."""
    bus, stop = MemoryBus(), threading.Event()
    source = opened(live, stop, bus)
    found = []

    def listen():
        for block in source:
            found.append(block)
            stop.set()

    thread = threading.Thread(target=listen)
    thread.start()
    key, n = SAMPLES.key("lab", "beam"), 0
    while thread.is_alive():
        message = SensorSamples(
            site="lab", asset="beam", boot="a", sequence=n, t_ns=0, rate_hz=500.0,
            first_index=10 * n, channels=NAMES, units=UNITS,
            samples=tuple((float(10 * n + i),) * 4 for i in range(10)),
        )  # fmt: skip
        bus.publish(key, encode(message), encoding=SAMPLES.encoding)
        n += 1
        thread.join(0.01)
    bus.close()
    return found[0]


@pytest.mark.parametrize(
    ("more", "factors", "units"),
    [
        ({}, (9.80665, 1e-3, 1.0, 1.0), ("m/s^2", "m/s", "mV", "1")),
        (
            {"units": ("w=um", "v=in/s"), "sensitivities": ("u=100mV/g",)},
            (9.80665, 0.0254, 1e-2 * 9.80665, 1e-6),
            ("m/s^2", "m/s", "m/s^2", "m"),
        ),
    ],
)
def test_samples_of_a_live_sensor_are_turned_into_si_once(more, factors, units):
    block = heard(LiveInput(source="zenoh:", **more))
    counts = block.first_index + np.arange(len(block.samples))
    np.testing.assert_allclose(block.samples, np.outer(counts, factors), rtol=1e-12)
    assert block.units == units


def test_a_unit_of_a_channel_that_a_sensor_lacks_is_refused_before_it_is_listened_to():
    live = LiveInput.of("tcp://127.0.0.1:9?layout=csv&channels=x,y&rate_hz=200", units=("z=g",))
    with pytest.raises(RecordError, match="z"):
        opened(live, threading.Event(), None)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "raw.mcap"
    block = Block(
        samples=np.arange(8.0).reshape(4, 2), rate_hz=100.0, first_index=0, start_ns=0,
        channels=("x", "y"), units=("g", ""),
    )  # fmt: skip
    header, body = raw_message(block, ORIGIN, 0)
    with RecordingWriter(path) as writer:
        writer.write(RAW, "lab", "beam", encode_raw(header, body), 0)
    return path


@pytest.mark.parametrize(
    ("given", "factors", "units"),
    [
        ({}, (1.0, 1.0), ("g", "")),
        ({"units": ("y=mm",)}, (9.80665, 1e-3), ("m/s^2", "m")),
        ({"units": ("mg",)}, (9.80665e-3,) * 2, ("m/s^2",) * 2),
    ],
)
def test_recorded_blocks_stay_as_they_are_unless_units_are_given(
    recording, given, factors, units
):
    source = open_source(
        RecordingInput(path=recording, **given), SystemClock(), threading.Event()
    )
    (block,) = source
    assert block is not None
    np.testing.assert_array_equal(block.samples, np.arange(8.0).reshape(4, 2) * factors)
    assert block.units == units


class Shown:
    """Reads nothing out of a window but which channels it was given."""

    def step(self, memory, window):
        return memory, ModeReading(channels=window.channels)


def test_features_tell_the_unit_of_each_channel_that_was_read(monkeypatch):
    monkeypatch.setattr(Extract, "_reader", Shown())
    stage = Extract(ExtractSettings(window_s=1.0, channels=("c", "a")), ORIGIN)
    block = Block(
        samples=np.zeros((100, 3)), rate_hz=100.0, first_index=0, start_ns=0,
        channels=("a", "b", "c"), units=("m/s^2", "m", ""),
    )  # fmt: skip
    _, (message,) = stage.step(stage.start(), block, np.zeros((100, 2), dtype=int))
    assert (message.channels, message.units) == (("c", "a"), ("", "m/s^2"))
