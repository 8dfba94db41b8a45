"""Good blocks come in, bad ones are refused with a reason, and no bad block spoils the next."""

import dataclasses
import threading
from typing import Any

import numpy as np
import pytest

from edge_agent.acquire import ADOPT_AFTER, Admission, Pacer, open_source
from edge_agent.settings import BlockAdmissionSettings, FileInput, SimulatedInput
from slowtime.signals.block import Block
from slowtime_services.clock import HandClock, SystemClock
from slowtime_services.simulate import SimulatedStructure
from twin_server.settings import AdmissionSettings as TwinAdmission

NOW_NS = 1_800_000_000_000_000_000


def block_at(index, count=100, **more):
    values = {
        "samples": np.ones((count, 1), "<f4"),
        "rate_hz": 100.0,
        "first_index": index,
        "start_ns": NOW_NS + index * 10_000_000,
        "channels": ("z",),
        "units": ("m/s^2",),
        **more,
    }
    return Block(**values)


def judge(blocks, *, time_base="live", now_ns=NOW_NS, **chosen):
    """The word for each block: the reason why it was refused, or None."""
    stage = Admission(BlockAdmissionSettings(**chosen), time_base)
    state, words = stage.start(), []
    for block in blocks:
        state, refusal = stage.step(state, block, now_ns)
        words.append(refusal.word if refusal else None)
        assert refusal is None or len(refusal.sentence) > 10
    return words


BAD: dict[str, dict[str, Any]] = {
    "empty": {"samples": np.ones((0, 1), "<f4")},
    "not_finite": {"samples": np.full((100, 1), np.nan, "<f4")},
    "wrong_rate": {"rate_hz": 50.0},
    "wrong_channels": {"channels": ("y",)},
    "wrong_units": {"units": ("g",)},
    "wrong_type": {"samples": np.ones((100, 1), "<i2")},
    "backwards": {"first_index": 50, "start_ns": NOW_NS + 500_000_000},
    "clock_jump": {"start_ns": NOW_NS + 5_000_000_000},
    "future": {"start_ns": NOW_NS + 90_000_000_000},
}


@pytest.mark.parametrize("word", BAD)
def test_a_bad_block_is_refused_for_its_reason_and_the_next_good_one_comes_in(word):
    bad = dataclasses.replace(block_at(200), **BAD[word])
    assert judge([block_at(0), block_at(100), bad, block_at(300)]) == [None, None, word, None]


def test_a_stale_clock_is_refused_only_where_asked():
    old = [block_at(0), block_at(100)]
    later = NOW_NS + 3600 * 10**9
    assert judge(old, now_ns=later) == [None, None]
    assert judge(old, now_ns=later, max_behind_s=60.0) == ["stale", "stale"]


def test_recorded_and_simulated_time_is_not_compared_with_ours():
    late = [block_at(0, start_ns=NOW_NS + 10**15)]
    assert judge(late, time_base="recorded") == [None]
    assert judge(late, time_base="live") == ["future"]


def test_a_gap_is_no_fault():
    assert judge([block_at(0), block_at(5000)]) == [None, None]


def test_the_same_block_twice_comes_in_once():
    assert judge([block_at(0), block_at(0)]) == [None, "backwards"]


def test_a_sensor_that_restarts_for_good_is_taken_up_again():
    restarted = [
        block_at(100 * n, start_ns=NOW_NS + 10**10 + n * 10**9) for n in range(ADOPT_AFTER + 5)
    ]
    words = judge([block_at(0), block_at(5000), *restarted])
    assert words[2:] == ["backwards"] * (ADOPT_AFTER - 1) + [None] * 6


def test_scattered_bad_blocks_are_never_taken_up():
    blocks = [block_at(0)]
    for n in range(1, 40):
        blocks += [block_at(100 * n), block_at(100 * n, rate_hz=50.0)]
    words = judge(blocks)
    assert words[1::2] == [None] * 39
    assert words[2::2] == ["wrong_rate"] * 39


def test_bad_blocks_that_contradict_each_other_are_never_taken_up():
    babble = [block_at(100 * n, rate_hz=50.0 + n) for n in range(1, 40)]
    words = judge([block_at(0), *babble, block_at(4000)])
    assert words == [None, *["wrong_rate"] * 39, None]


def test_the_state_does_not_keep_samples_alive():
    stage = Admission(BlockAdmissionSettings())
    state, _ = stage.step(stage.start(), block_at(0, count=100_000), NOW_NS)
    assert state.last is not None
    assert state.last.samples.strides == (0, 0)


def test_a_file_becomes_a_stream_with_its_gaps_and_its_missing_values(tmp_path):
    clock = np.delete(np.arange(400) / 100, slice(150, 160))
    rows = [f"{t:.2f},{n}" for n, t in enumerate(clock)]
    rows[30] = "0.30,"
    path = tmp_path / "record.csv"
    path.write_text("t,z [g]\n" + "\n".join(rows) + "\n")
    chosen = FileInput(path=path, block_s=0.5, start_ns=NOW_NS)
    source = open_source(chosen, HandClock(), threading.Event())
    blocks = [block for block in source if block is not None]
    assert (source.time_base, blocks[0].units, blocks[0].start_ns) == (
        "recorded",
        ("m/s^2",),
        NOW_NS,
    )
    np.testing.assert_allclose(blocks[0].samples[:3, 0], [0.0, 9.80665, 2 * 9.80665])
    assert [block.first_index for block in blocks[:5]] == [0, 50, 100, 160, 210]
    assert np.isnan(blocks[0].samples).sum() == 1


def test_a_file_in_volts_becomes_accelerations_by_its_sensitivities(tmp_path):
    x, z = np.random.default_rng(1).standard_normal((2, 200))
    np.savez(tmp_path / "a.npz", x=x, z=z, rate_hz=100.0)
    chosen = FileInput(
        path=tmp_path / "a.npz", units=("V", "x=mg"), sensitivities=("z=100mV/g",)
    )
    source = open_source(chosen, HandClock(), threading.Event())
    first = next(block for block in source if block is not None)
    assert first.units == ("m/s^2", "m/s^2")
    np.testing.assert_allclose(first.samples[1], [9.80665e-3 * x[1], 98.0665 * z[1]])


def test_a_file_without_a_time_begins_where_a_twin_takes_it_and_says_so(tmp_path, caplog):
    np.savez(tmp_path / "a.npz", z=np.arange(200.0), rate_hz=100.0)
    source = open_source(FileInput(path=tmp_path / "a.npz"), HandClock(), threading.Event())
    first = next(block for block in source if block is not None)
    assert first.start_ns >= TwinAdmission().not_before_ns
    assert "does not state its start" in caplog.text


def test_a_file_is_paced_by_the_clock_where_asked(tmp_path):
    np.savez(tmp_path / "a.npz", z=np.arange(500.0) ** 0.5, rate_hz=100.0)
    clock = HandClock(NOW_NS)
    chosen = FileInput(path=tmp_path / "a.npz", speed=2.0, block_s=1.0)
    moments = []
    for _ in open_source(chosen, clock, threading.Event()):
        moments.append((clock.now_ns() - NOW_NS) / 1e9)
    np.testing.assert_allclose(moments, [0.5, 1.0, 1.5, 2.0, 2.5], atol=1e-6)


def test_simulated_epochs_come_when_they_are_due_and_say_when_they_are_complete():
    structure = SimulatedStructure(epochs=4, seconds=1.0, interval_s=1.0)
    clock = HandClock(NOW_NS)
    source = open_source(
        SimulatedInput(structure=structure, every_s=0.25, first_epoch=1),
        clock,
        threading.Event(),
    )
    seen = [
        (block.epoch if block else None, (clock.now_ns() - NOW_NS) / 1e9) for block in source
    ]
    assert seen == [(1, 0.0), (None, 0.0), (2, 0.25), (None, 0.25), (3, 0.5), (None, 0.5)]


def test_a_held_calendar_stands_still_and_does_not_catch_up(tmp_path, monkeypatch):
    structure = SimulatedStructure(epochs=4, seconds=1.0, interval_s=1.0)
    hold, clock = tmp_path / "hold", HandClock(NOW_NS)
    sleep = clock.sleep

    def slept(seconds):
        sleep(max(seconds, 1e-3))  # less than a nanosecond would move no clock of whole ones
        if clock.now_ns() - NOW_NS >= 2_000_000_000:
            hold.unlink(missing_ok=True)

    monkeypatch.setattr(clock, "sleep", slept)
    chosen = SimulatedInput(structure=structure, every_s=0.25, hold=hold)
    moments = []
    for block in open_source(chosen, clock, threading.Event()):
        if block is None:
            continue
        moments.append((clock.now_ns() - NOW_NS) / 1e9)
        if block.epoch == 1:
            hold.touch()
    assert moments[:2] == [0.0, 0.25]
    assert moments[2] == pytest.approx(2.0, abs=0.2)
    assert moments[3] == pytest.approx(moments[2] + 0.25)


def test_a_wait_ends_at_once_when_the_agent_is_stopped():
    stop = threading.Event()
    threading.Timer(0.1, stop.set).start()
    assert Pacer(SystemClock(), stop).wait_until(60.0) is False
