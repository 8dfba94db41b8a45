"""The stages together: cuts change nothing, nothing stops them, a rerun is the same bytes."""

import dataclasses
import functools
import itertools
import logging
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_agent.__main__ import new_boot, run
from edge_agent.acquire import ADOPT_AFTER
from edge_agent.pipeline import Edge, rerun
from edge_agent.publish import Publisher
from edge_agent.settings import EdgeSettings, Origin, Processing
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.messages import About, Features, Health
from slowtime_schemas.streams import ABOUT, FEATURES, HEALTH, RAW, request_key
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.clock import HandClock
from slowtime_services.replay import block_of
from slowtime_services.simulate import FatigueLoss, SensorErrors, SimulatedStructure

STRUCTURE = SimulatedStructure(
    seconds=30.0,
    sensor=SensorErrors(spikes_per_epoch=2.0, dropouts_per_epoch=1.0),
    stiffness=FatigueLoss(),
    epochs=6,
)
ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="simulated")
FAST = {"method": "ambient", "window_s": 20.0, "hop_s": 7.0}


class Given:
    """A source of blocks that are at hand already."""

    time_base = "simulated"
    slow_time_unit = "T0"

    def __init__(self, items):
        self.items = items

    def __iter__(self):
        yield from self.items


class House:
    """An edge agent run to its end on a bus that keeps what it heard."""

    def __init__(self, folder, source, *, stop=None, bus=None, clock=None, **chosen):
        self.heard: list[tuple[str, bytes]] = []
        self.bus = bus or MemoryBus()
        self.bus.subscribe(
            "slowtime/**", lambda sample: self.heard.append((sample.key, sample.payload))
        )
        publish = {"linger_s": 0.0, "health_every_s": 60.0, **chosen.pop("publish", {})}
        self.settings = EdgeSettings(
            site="lab",
            asset="beam",
            boot=chosen.pop("boot", "b1"),
            extract={**FAST, **chosen.pop("extract", {})},
            spool={"folder": folder},
            publish=publish,
            **chosen,
        )
        self.status = run(
            self.settings,
            bus=self.bus,
            clock=clock or HandClock(2 * 10**18),
            source=source,
            stop=stop or threading.Event(),
        )

    def payloads(self, stream):
        return [p for key, p in self.heard if key == stream.key("lab", "beam")]

    @property
    def features(self):
        return [Features.model_validate_json(p) for p in self.payloads(FEATURES)]

    @property
    def health(self):
        return Health.model_validate_json(self.payloads(HEALTH)[-1])


def cut(block, where):
    edges = [0, *sorted(w for w in where if w < len(block.samples)), len(block.samples)]
    for first, last in itertools.pairwise(edges):
        yield dataclasses.replace(
            block,
            samples=block.samples[first:last],
            first_index=block.first_index + first,
            start_ns=block.start_ns + round(first * 1e9 / block.rate_hz),
        )


def through(blocks):
    edge = Edge.of(Processing.model_validate({"extract": FAST}), ORIGIN)
    out: tuple[Features, ...] = ()
    state = edge.start()
    for block in blocks:
        state, features = edge.step(state, block)
        out += features
    return out + edge.finish(state)[1]


def continuous():
    rng = np.random.default_rng(3)
    (block,) = SimulatedStructure(seconds=70.0).epoch(0)
    samples = block.samples.astype(float)
    samples[rng.integers(0, 7000, 8)] += 5.0
    samples[3000:3012] = np.nan
    return dataclasses.replace(block, samples=samples, epoch=None, slow_time=None)


STREAM = continuous()
EPOCHS = [block for epoch in range(3) for block in STRUCTURE.epoch(epoch)]


@functools.cache
def whole_stream():
    return through([STREAM])


@functools.cache
def whole_epochs():
    return through(EPOCHS)


def close(one, other):
    """Equal, but for the rounding of times to whole nanoseconds and of sums."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert abs(a.t_ns - b.t_ns) <= 2
        assert (a.quality, a.sequence, len(a.modes)) == (b.quality, b.sequence, len(b.modes))
        for x, y in zip(a.modes, b.modes, strict=True):
            assert x.frequency_hz.value == pytest.approx(y.frequency_hz.value, rel=1e-9)
            assert x.frequency_hz.sd == pytest.approx(y.frequency_hz.sd, rel=1e-6)


@pytest.mark.long
@settings(max_examples=12, deadline=None)
@given(where=st.sets(st.integers(1, 6999), max_size=12))
def test_cutting_a_stream_anywhere_changes_no_feature(where):
    close(through(cut(STREAM, where)), whole_stream())


@pytest.mark.long
@settings(max_examples=8, deadline=None)
@given(where=st.sets(st.integers(1, 2999), max_size=8))
def test_cutting_epochs_anywhere_changes_no_feature(where):
    close(through(piece for block in EPOCHS for piece in cut(block, where)), whole_epochs())


def test_epochs_become_features_in_order_with_their_truth(tmp_path):
    house = House(tmp_path, Given([*STRUCTURE.blocks()]))
    assert house.status == 0
    assert [m.sequence for m in house.features] == [0, 1, 2, 3, 4, 5]
    assert [m.slow_time for m in house.features] == [0, 1, 2, 3, 4, 5]
    assert all(m.truth == STRUCTURE.truth(n) for n, m in enumerate(house.features))
    found = [m for m in house.features if m.modes]
    assert len(found) >= 5
    for m in found:
        frequency = m.modes[0].frequency_hz
        assert abs(frequency.value - m.truth["frequency_hz"]) < 4.5 * frequency.sd
    assert house.health.last_sequence == 5
    assert house.health.counters["features"] == 6


def test_health_tells_what_a_window_cost_and_how_much_time_there_was(tmp_path, monkeypatch):
    from edge_agent.extract import Extract

    clock, real, costs = HandClock(2 * 10**18), Extract.finish, iter([0.0, 0.2, 0.9, 0.3, 0.0])

    def dear(self, state):
        clock.sleep(next(costs))
        return real(self, state)

    class Paced(Given):
        def __iter__(self):
            for item in self.items:
                clock.sleep(0.0 if item is None else 2.0)
                yield item

    monkeypatch.setattr(Extract, "finish", dear)
    items = [item for n in range(4) for item in (*STRUCTURE.epoch(n)[:1], None)]
    house = House(tmp_path, Paced(items), clock=clock)
    told = {k: v for k, v in house.health.counters.items() if k.endswith("_ms")}
    assert told == {
        "busy_ms": 1400,
        "window_busy_ms": 300,
        "window_busy_max_ms": 900,
        "window_period_ms": 2300,
    }


def test_health_tells_how_far_a_live_sensor_is_ahead_of_its_features(tmp_path):
    (block,) = SimulatedStructure(seconds=30.0, start_ns=2 * 10**18 - 31 * 10**9).epoch(0)

    class Live(Given):
        time_base = "live"

    house = House(tmp_path, Live([block, None]))
    assert house.health.counters["behind_ms"] == 1010
    assert "window_period_ms" not in house.health.counters


def test_an_epoch_that_is_complete_is_told_before_the_next_begins(tmp_path):
    told: list[int] = []
    bus = MemoryBus()
    bus.subscribe(FEATURES.key("lab", "beam"), lambda sample: told.append(1))

    class Asking(Given):
        def __iter__(self):
            for epoch in range(3):
                yield from STRUCTURE.epoch(epoch)
                yield None
                assert len(told) == epoch + 1

    House(tmp_path, Asking([]), bus=bus)
    assert len(told) == 3


BAD: dict[str, dict[str, Any]] = {
    "refused_not_finite": {"samples": np.full((3000, 1), np.nan, "<f4")},
    "refused_empty": {"samples": np.zeros((0, 1), "<f4")},
    "refused_wrong_rate": {"rate_hz": 99.0},
    "refused_wrong_units": {"units": ("g",)},
    "refused_wrong_channels": {"channels": ("other",)},
    "refused_backwards": {"first_index": 0},
    "refused_clock_jump": {"start_ns": 1, "first_index": 6000},
}


@pytest.mark.parametrize("word", BAD)
def test_a_bad_block_is_counted_and_the_next_good_one_is_worked(tmp_path, word, caplog):
    good = [STRUCTURE.epoch(n) for n in range(3)]
    bad = dataclasses.replace(good[1][0], **BAD[word])
    blocks = [*good[0], *good[1], bad, *good[2]]
    with caplog.at_level(logging.WARNING):
        house = House(tmp_path, Given(blocks))
    assert house.health.counters[word] == 1
    assert house.payloads(FEATURES) == [encode(m) for m in expected(blocks, bad)]
    assert any(word.removeprefix("refused_") in record.message for record in caplog.records)


def expected(blocks, bad):
    edge = Edge.of(
        Processing.model_validate({"extract": FAST}),
        ORIGIN.model_copy(update={"slow_time_unit": "T0"}),
    )
    out: tuple[Features, ...] = ()
    state = edge.start()
    for block in blocks:
        if block is not bad:
            state, features = edge.step(state, block)
            out += features
    return out + edge.finish(state)[1]


def test_what_fails_inside_a_stage_costs_its_epoch_and_nothing_else(tmp_path, monkeypatch):
    from edge_agent.extract import Extract

    real, calls = Extract.finish, []

    def sometimes(self, state):
        calls.append(1)
        if len(calls) == 2:
            raise ZeroDivisionError("a bug of ours")
        return real(self, state)

    monkeypatch.setattr(Extract, "finish", sometimes)
    items = [item for n in range(4) for item in (*STRUCTURE.epoch(n), None)]
    house = House(tmp_path, Given(items))
    assert [m.slow_time for m in house.features] == [0, 2, 3]
    assert [m.sequence for m in house.features] == [0, 1, 2]
    assert house.health.counters["failed_blocks"] == 1


def test_features_that_cannot_be_published_cost_no_others(tmp_path, monkeypatch):
    real = Publisher.features

    def sometimes(self, message):
        if message.sequence == 1:
            raise IndexError("a bug of ours")
        real(self, message)

    monkeypatch.setattr(Publisher, "features", sometimes)
    items = [item for n in range(4) for item in (*STRUCTURE.epoch(n), None)]
    house = House(tmp_path, Given(items))
    assert house.status == 0
    assert [m.sequence for m in house.features] == [0, 2, 3]
    assert house.health.counters["failed_features"] == 1


def test_a_sensor_that_is_set_up_anew_is_followed_after_some_blocks(tmp_path):
    anew = [
        dataclasses.replace(b, units=("g",))
        for n in range(1, 14)
        for b in STRUCTURE.epoch(n)[:1]
    ]
    house = House(tmp_path, Given([*STRUCTURE.epoch(0), *anew]))
    assert house.health.counters["refused_wrong_units"] == ADOPT_AFTER - 1
    assert len(house.features) == 1 + 13 - (ADOPT_AFTER - 1)


def test_stopping_closes_what_was_begun_and_leaves_everything_on_disk(tmp_path):
    stop = threading.Event()

    class Stopped(Given):
        def __iter__(self):
            yield from STRUCTURE.epoch(0)
            stop.set()
            yield from STRUCTURE.epoch(1)
            raise AssertionError("asked on after the stop")

    house = House(tmp_path, Stopped([]), stop=stop)
    assert house.status == 0
    assert 1 <= len(house.features) <= 2
    held: list[bytes] = []

    class Asked(Given):
        def __iter__(self):
            answers = house.bus.ask(request_key("lab", "beam", "features"), {"boot": "b1"})
            held.extend(sample.payload for sample in answers)
            yield from ()

    House(tmp_path, Asked([]), boot="b2", bus=house.bus)
    assert held == house.payloads(FEATURES)


def test_a_source_that_breaks_ends_the_agent_but_not_before_its_features_are_told(tmp_path):
    class Breaking(Given):
        def __iter__(self):
            yield from STRUCTURE.epoch(0)
            raise OSError("the cable was pulled")

    heard: list[bytes] = []
    bus = MemoryBus()
    bus.subscribe(FEATURES.key("lab", "beam"), lambda sample: heard.append(sample.payload))
    with pytest.raises(OSError, match="cable"):
        House(tmp_path, Breaking([]), bus=bus)
    assert len(heard) == 1


@pytest.mark.long
@pytest.mark.parametrize("dtype", ["<f4", "<f8"])
def test_a_rerun_over_recorded_raw_blocks_gives_the_same_bytes(tmp_path, dtype):
    structure = STRUCTURE.model_copy(
        update={"sensor": SensorErrors(spikes_per_epoch=2, dtype=dtype)}
    )
    source = Given([item for n in range(4) for item in (*structure.epoch(n), None)])
    first = House(tmp_path / "1", source, publish={"raw": "on"}, extract={"ewma_a": 0.25})
    second = House(
        tmp_path / "2", source, boot="b2", publish={"raw": "on"}, extract={"ewma_a": 0.25}
    )
    about = About.model_validate_json(first.payloads(ABOUT)[0])
    recorded = first.payloads(RAW) + second.payloads(RAW)
    again = list(rerun(map(block_of, recorded), Processing.from_about(about)))
    assert again == first.payloads(FEATURES) + second.payloads(FEATURES)
    other = Processing.model_validate({"extract": FAST})
    assert list(rerun(map(block_of, recorded), other)) != again


def test_a_rerun_of_a_stream_is_the_same_bytes_whatever_was_refused(tmp_path):
    pieces = list(cut(STREAM, range(0, 7000, 333)))[1:]
    bad = dataclasses.replace(pieces[5], rate_hz=7.0)
    source = Given([*pieces[:6], bad, pieces[3], *pieces[6:]])
    house = House(tmp_path, source, publish={"raw": "on"})
    about = About.model_validate_json(house.payloads(ABOUT)[0])
    again = list(rerun(map(block_of, house.payloads(RAW)), Processing.from_about(about)))
    assert again == house.payloads(FEATURES) != []
    assert house.health.counters["refused_backwards"] == 1


def test_a_rerun_says_where_a_raw_block_is_missing_and_takes_none_twice(tmp_path):
    source = Given([item for n in range(4) for item in (*STRUCTURE.epoch(n)[:1], None)])
    house = House(tmp_path, source, publish={"raw": "on"})
    blocks = [block_of(payload) for payload in house.payloads(RAW)]
    processing = house.settings.processing
    twice = [block for block in blocks for _ in range(2)]
    assert list(rerun(twice, processing)) == house.payloads(FEATURES)
    with pytest.raises(
        ValueError, match=r"Raw block 0 of lab.beam, start b1 .* the next one is 1.*start"
    ):
        list(rerun(blocks[1:], processing))
    again = rerun([*blocks[:2], blocks[3]], processing)
    assert next(again) == house.payloads(FEATURES)[0]
    with pytest.raises(ValueError, match=r"Raw block 2 .* is missing"):
        list(again)


def test_the_last_raw_seconds_can_be_asked_for_while_the_agent_runs(tmp_path):
    got: list[Sample] = []
    bus = MemoryBus()

    class Asked(Given):
        def __iter__(self):
            yield from cut(STREAM, range(100, 2000, 100))
            got.extend(bus.ask(request_key("lab", "beam", "raw"), {"seconds": "3"}))

    House(tmp_path, Asked([]), bus=bus, publish={"ring_s": 5.0})
    headers = [block_of(sample.payload)[0] for sample in got]
    assert headers[-1].samples == 5100
    assert len(headers) == 1


def test_the_heartbeat_beats_while_the_source_is_silent(tmp_path):
    class Silent(Given):
        def __iter__(self):
            threading.Event().wait(0.35)
            yield from ()

    house = House(tmp_path, Silent([]), publish={"health_every_s": 0.05, "about_every_s": 0.1})
    assert len(house.payloads(HEALTH)) >= 6
    assert len(house.payloads(ABOUT)) >= 3
    words = [decode(HEALTH, payload).sequence for payload in house.payloads(HEALTH)]
    assert words == list(range(len(words)))


def test_a_heartbeat_that_fails_is_not_the_last(tmp_path, monkeypatch):
    asked = []
    healthy = threading.Event()

    class Silent(Given):
        def __iter__(self):
            healthy.wait(10)
            yield from ()

    real = Publisher.health

    def sometimes(self):
        asked.append(1)
        if len(asked) == 2:  # the first of the heartbeat
            raise OSError(5, "Input/output error")
        real(self)
        if len(asked) > 2:
            healthy.set()

    monkeypatch.setattr(Publisher, "health", sometimes)
    house = House(tmp_path, Silent([]), publish={"health_every_s": 0.05})
    assert len(asked) > 3
    assert house.health.counters["failed_heartbeats"] == 1


def test_boots_are_named_so_that_they_sort_and_never_meet():
    clock = HandClock(1_800_000_000_000_000_000)
    names = set()
    for _ in range(50):
        names.add(new_boot(clock))
        clock.sleep(0.001)
    assert len(names) == 50
    early = new_boot(clock)
    clock.sleep(1.0)
    assert early < new_boot(clock)
