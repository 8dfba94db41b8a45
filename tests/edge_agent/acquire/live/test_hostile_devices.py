"""What a device states costs what it sends, not what it says; and the stream goes on."""

import json
import threading
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import edge_agent
from edge_agent.acquire.live.batch import Batch, GarbledError
from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.acquire.live.formats import framing
from edge_agent.acquire.live.formats.decoding import bounded, decoder_of
from edge_agent.acquire.live.formats.framing import LineFramer, framer_of
from edge_agent.acquire.live.indexing.assembly import Assembler
from edge_agent.acquire.live.indexing.bursts import Backlog
from edge_agent.acquire.live.indexing.counters import ByCounter
from edge_agent.acquire.live.indexing.positions import ByArrival
from edge_agent.condition import Conditioner
from edge_agent.inputs import LiveInput
from edge_agent.layouts import CounterField, CsvLayout, JsonLayout, PackedLayout, Stamp
from edge_agent.settings import ConditionSettings
from slowtime.signals.block import Block
from slowtime_schemas.streams import SAMPLES
from slowtime_services.bus import MemoryBus
from tests.state_machines import steps_in

from .listening import opened

FOLDER = Path(edge_agent.__file__).parent
CHANNELS = [{"name": name} for name in "xyz"]
CLAIMS = (1e300, 1e-300, 1e9, 1e-9, 5e-324)
NOW_NS = 1_780_000_000_000_000_000
YEAR_NS = 365 * 86_400 * 10**9


def peak_of(work):
    """Most memory that was in use meanwhile [bytes]."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def samples_message(n, rate_hz, names=("z",), units=("g",)):
    return json.dumps(
        {
            "version": 1, "site": "lab", "asset": "beam", "boot": "a", "sequence": n, "t_ns": 0,
            "rate_hz": rate_hz, "first_index": 10 * n, "channels": names, "units": units,
            "samples": [[float(i)] * len(names) for i in range(10)],
        }
    ).encode()  # fmt: skip


def test_a_first_message_that_no_device_sends_is_passed_over_and_the_next_is_taken():
    bus, stop = MemoryBus(), threading.Event()
    source = opened(LiveInput(source="zenoh:", block_s=0.02), stop, bus)
    key = SAMPLES.key("lab", "beam")
    for rate_hz in CLAIMS:
        bus.publish(key, samples_message(0, rate_hz), encoding=SAMPLES.encoding)
    for names in (("",), ("a\n",), ("a", "a"), ("x" * 300,)):
        message = samples_message(0, 500.0, names, ("g",) * len(names))
        bus.publish(key, message, encoding=SAMPLES.encoding)
    for n in range(5):
        bus.publish(key, samples_message(n, 500.0), encoding=SAMPLES.encoding)
    timer = threading.Timer(60.0, stop.set)
    timer.start()
    blocks = []
    for block in source:
        blocks.append(block)
        if sum(len(one.samples) for one in blocks) >= 50:
            stop.set()
    timer.cancel()
    assert sum(len(one.samples) for one in blocks) == 50
    assert {(one.rate_hz, one.channels) for one in blocks} == {(500.0, ("z",))}


@pytest.mark.parametrize("rate_hz", [1e300, 1e-300])
def test_a_rate_that_no_device_has_is_refused_with_what_is_allowed(rate_hz):
    with pytest.raises(ValueError, match="rate_hz"):
        LiveInput(source="stdin:", rate_hz=rate_hz)


@pytest.mark.parametrize("kind", ["json", "csv"])
@pytest.mark.parametrize("number", [2**64, -(2**64), 10**30, "1e308", 2**63])
def test_counters_and_stamps_beyond_all_clocks_are_garbage(kind, number):
    given = {"counter": {"at": "n"}, "stamp": {"at": "t", "unit": "ns", "clock": "utc"}}
    if kind == "json":
        layout: JsonLayout | CsvLayout = JsonLayout(channels=CHANNELS, **given)
        data = [
            '{"n": 1, "t": %s, "x": 0, "y": 0, "z": 0}',
            '{"n": %s, "t": 1, "x": 0, "y": 0, "z": 0}',
        ]
    else:
        layout = CsvLayout(channels=CHANNELS, columns=("n", "t", "x", "y", "z"), **given)
        data = ["1,%s,0,0,0", "%s,1,0,0,0"]
    decode = bounded(decoder_of(layout), layout)
    assert len(decode((data[0] % 5).encode(), 0)) == 1
    with pytest.raises(GarbledError):
        decode((data[0] % number).encode(), 0)
    if number != 2**63:  # a counter may have 64 bits
        with pytest.raises(GarbledError):
            decode((data[1] % number).encode(), 0)


@pytest.mark.parametrize("t_ns", [-1, 2**63, 253_402_300_799 * 10**9])
def test_stamps_of_before_1970_and_after_2262_are_garbage(t_ns):
    layout = JsonLayout(channels=CHANNELS, stamp=Stamp(at="t", unit="ns", clock="utc"))
    decode = bounded(decoder_of(layout), layout)
    with pytest.raises(GarbledError, match="before 1970, or after 2262"):
        decode(json.dumps({"t": t_ns, "x": 0, "y": 0, "z": 0}).encode(), 0)
    assert decode(json.dumps({"t": 2**63 - 1, "x": 0, "y": 0, "z": 0}).encode(), 0)


def test_a_message_as_large_as_a_broker_passes_on_is_not_parsed():
    layout = JsonLayout(channels=CHANNELS)
    decode = bounded(decoder_of(layout), layout)
    data = b"[" + b"0," * 2**23 + b"0]"

    def refused():
        with pytest.raises(GarbledError, match="bytes"):
            decode(data, 0)

    assert peak_of(refused) < 2**20


def test_a_line_without_end_costs_the_same_for_each_byte_however_it_is_cut():
    framer, began_s = LineFramer(), time.process_time()
    for _ in range(60_000):
        assert not list(framer.feed(b"1" * 16))
    # Each packet copied the line before it: 29 GB in all, 4 s and more.
    assert time.process_time() - began_s < 1.0
    assert list(framer.feed(b"\n1,2\n")) == [b"1" * 960_000, b"1,2"]


def copied_bytes(monkeypatch, framer, packets):
    """Bytes that are verified as frames, of all that is fed."""
    verified, sound = [], vars(framing)["is_sound"]

    def noted(layout, frame):
        verified.append(len(frame))
        return sound(layout, frame)

    monkeypatch.setattr(framing, "is_sound", noted)
    for packet in packets:
        list(framer.feed(packet))
    return sum(verified)


def test_a_stream_made_of_beginnings_of_frames_is_verified_a_bounded_number_of_times(
    monkeypatch,
):
    layout = PackedLayout(
        channels=CHANNELS[:1], sync="a55a", header=("samples:u16",), samples=None,
        type="i16", checksum="crc32",
    )  # fmt: skip
    deceiving = (b"\xa5\x5a\xf0\x1f" * 16_384)[:65_536]
    verified = copied_bytes(monkeypatch, framer_of(layout), [deceiving] * 6)
    assert verified < 40 * 6 * 65_536


@pytest.mark.parametrize("samples", [2**32 - 1, 2**31, 0])
def test_a_frame_that_states_gigabytes_is_no_frame(samples):
    layout = PackedLayout(
        channels=CHANNELS[:1], sync="a55a", header=("samples:u32",), type="i16", checksum="sum8"
    )
    framer = framer_of(layout)
    head = bytes.fromhex("a55a") + samples.to_bytes(4, "little")
    assert peak_of(lambda: list(framer.feed(head + bytes(100)))) < 2**20
    assert framer.garbage_bytes > 90


def test_many_parts_of_one_message_are_joined_once():
    layout = JsonLayout(channels=CHANNELS[:1], counter=CounterField(at="n", counts="messages"))
    data = json.dumps([{"n": 1, "x": i} for i in range(20_000)]).encode()
    decode = bounded(decoder_of(layout), layout)
    with steps_in(FOLDER) as steps:
        (batch,) = decode(data, 0)
    assert np.shape(batch.rows) == (20_000, 1)
    assert steps.count < 60 * 20_000


@pytest.mark.parametrize("counter", [2**40, 2**62, 2**63, 2**64 - 1])
def test_a_counter_that_jumps_makes_neither_rows_nor_losses_of_all_between(counter):
    tally = SampleCounts()
    positions = ByCounter(CounterField(bits=64), 100.0, 25, tally)
    assembler = Assembler(((0,),), 50, 25, tally)

    def jump():
        for n in range(200):
            at = counter if n == 100 else n
            batch = Batch(np.zeros((1, 1)), NOW_NS + n * 10**7, at)
            for index, placed, _ in positions.place(batch):
                assembler.put(index, placed.rows)
            assembler.take()

    with steps_in(FOLDER) as steps:
        assert peak_of(jump) < 2**20
    assert steps.count < 200 * 400
    assert tally["samples_refused"] == 1
    assert tally["samples_lost"] <= 1


def test_a_lane_whose_counter_is_far_from_that_of_another_does_not_displace_it():
    tally = SampleCounts()
    one, other = (ByCounter(CounterField(bits=64), 100.0, 25, tally) for _ in range(2))
    for n in range(50):
        one.place(Batch(np.zeros((1, 1)), NOW_NS + n * 10**7, n))
    strange = Batch(np.zeros((1, 1)), NOW_NS + 50 * 10**7, 2**62, lane=1)
    other.begin_beside(one, strange)
    ((index, _, _),) = other.place(strange)
    assert abs(index - 50) <= 1


@pytest.mark.parametrize(("rate_hz", "columns"), [(1e8, 1), (1e8, 4096), (1e6, 64)])
def test_buffers_are_no_larger_than_is_waited_for_at_most(rate_hz, columns):
    def make():
        Assembler((tuple(range(columns)),), round(rate_hz), round(rate_hz), SampleCounts())

    assert peak_of(make) < 2**28


def test_a_clock_set_back_holds_nothing_back():
    """Samples wait for times that are years away; memory would grow for as long."""
    for positions in (
        ByArrival(100.0, SampleCounts()),
        ByCounter(CounterField(bits=8), 100.0, 25, SampleCounts()),
    ):
        placed = 0
        for n in range(400):
            back = YEAR_NS if n >= 205 else 0
            pause = 5 * 10**9 if n >= 200 else 0
            arrival_ns = NOW_NS + n * 10**7 + pause - back
            placed += len(positions.place(Batch(np.zeros((1, 1)), arrival_ns, n)))
        assert placed > 380


def test_a_backlog_ends_though_the_clock_is_set_back_meanwhile():
    backlog = Backlog(100.0)
    for n in range(300):
        backlog.note(NOW_NS + n * 10**7 - (YEAR_NS if n > 10 else 0), 1)
    assert not backlog.lasts
    assert len(backlog._recent) < 200


def test_a_gap_at_a_high_rate_is_not_filled_beyond_what_is_bridged():
    condition = Conditioner(ConditionSettings(max_gap_s=10.0))
    state = condition.start()

    def step():
        nonlocal state
        for first in (0, 50_000_000):
            block = Block(
                samples=np.ones((512, 4)), rate_hz=1e7, first_index=first, start_ns=first * 100,
                channels=tuple("abcd"), units=("g",) * 4,
            )  # fmt: skip
            state, _ = condition.step(state, block)
        condition.finish(state)

    assert peak_of(step) < 2**26
