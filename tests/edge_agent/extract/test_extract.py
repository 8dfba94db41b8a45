"""Every window gives one message, found or not, whose numbers are those of its samples."""

import dataclasses

import numpy as np
import pytest
from pydantic import ValidationError

from edge_agent.extract import Extract
from edge_agent.settings import EdgeSettings, ExtractSettings, Origin
from slowtime.identification.single_mode.sliding_windows import Tracker
from slowtime.signals.block import Block
from slowtime_schemas.messages import Features
from slowtime_services.simulate import SensorErrors, SimulatedStructure

ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="simulated", slow_time_unit="T0")
STRUCTURE = SimulatedStructure(seconds=60.0, sensor=SensorErrors(noise=0.02))


def unmarked(block):
    return np.zeros((len(block.samples), 2), dtype=np.int64)


def run(blocks, marks=unmarked, finish=True, **chosen):
    stage = Extract(ExtractSettings(method="ambient", **chosen), ORIGIN)
    out: tuple[Features, ...] = ()
    state = stage.start()
    for block in blocks:
        state, found = stage.step(state, block, marks(block))
        out += found
    return out + stage.finish(state)[1] if finish else out


def stream(seconds, first_index=0, seed=0):
    """A continuous stream, of no epoch, whose sensor time begins at 10^18 ns."""
    (block,) = SimulatedStructure(seconds=seconds, seed=seed).epoch(0)
    return dataclasses.replace(
        block,
        samples=block.samples.astype(float),
        epoch=None,
        slow_time=None,
        first_index=first_index,
        start_ns=10**18 + first_index * 10**7,
    )


def test_an_epoch_gives_its_frequency_with_an_honest_error_its_times_and_its_truth():
    (block,) = STRUCTURE.epoch(4)
    (message,) = run([block])
    (mode,) = message.modes
    assert abs(mode.frequency_hz.value - 5.0) < 4 * mode.frequency_hz.sd < 0.2
    assert abs(mode.damping_ratio.value - 0.02) < 4 * mode.damping_ratio.sd
    assert (message.sequence, message.slow_time, message.slow_time_unit) == (0, 4.0, "T0")
    assert (message.boot, message.time_base, message.method) == ("b1", "simulated", "ambient")
    assert message.start_ns == block.start_ns
    assert message.t_ns == block.start_ns + 59_990_000_000
    assert message.truth == block.truth
    assert message.quality.samples == 6000
    assert mode.snr_db is not None


def test_epochs_follow_each_other_without_being_told_where_one_ends():
    blocks = [block for epoch in range(3) for block in STRUCTURE.epoch(epoch)]
    messages = run(blocks)
    assert [m.sequence for m in messages] == [0, 1, 2]
    assert [m.slow_time for m in messages] == [0.0, 1.0, 2.0]


def test_a_quiet_sensor_is_told_of_and_not_passed_over():
    (block,) = STRUCTURE.epoch(0)
    dead = dataclasses.replace(block, samples=np.full((6000, 1), 0.25))
    noise = np.random.default_rng(0).standard_normal((6000, 1))
    quiet = dataclasses.replace(block, samples=noise, epoch=1)
    short = dataclasses.replace(block, samples=noise[:20], epoch=2)
    messages = run([dead, quiet, short])
    assert [m.modes for m in messages] == [(), (), ()]
    assert [m.method for m in messages] == ["none"] * 3
    flags = [m.quality.flags for m in messages]
    assert flags == [("not_usable",), ("no_mode",), ("too_short",)]


def test_an_epoch_torn_by_a_long_gap_is_read_where_it_is_longest():
    (block,) = STRUCTURE.epoch(2)
    first = dataclasses.replace(block, samples=block.samples[:1000])
    second = dataclasses.replace(
        block,
        samples=block.samples[1500:],
        first_index=block.first_index + 1500,
        start_ns=block.start_ns + 15 * 10**9,
    )
    (message,) = run([first, second], max_missing=0.2)
    assert message.quality.flags == ("gap",)
    assert (message.quality.samples, message.quality.missing) == (4500, 500)
    assert message.start_ns == second.start_ns
    assert len(message.modes) == 1
    (message,) = run([first, second], max_missing=0.05)
    assert message.quality.flags == ("gap", "too_much_missing")


def test_marks_are_summed_over_the_window():
    (block,) = STRUCTURE.epoch(0)

    def marks(block):
        marks = unmarked(block)
        marks[10:15, 0] = 1
        marks[[20, 30], 1] = 1, 2
        return marks

    (message,) = run([block], marks)
    assert (message.quality.missing, message.quality.outliers) == (5, 3)


def test_a_stream_slides_in_hops_and_dates_each_window_by_its_middle():
    block = stream(100.0)
    messages = run([block], window_s=40.0, hop_s=20.0)
    assert [(m.start_ns - 10**18) // 10**9 for m in messages] == [0, 20, 40, 60]
    assert messages[1].t_ns == 10**18 + 59_990_000_000
    assert messages[1].slow_time == pytest.approx(1e9 + 39.995, abs=1e-6)
    assert [m.quality.samples for m in messages] == [4000] * 4
    touching = run([block], window_s=40.0)
    assert [(m.start_ns - 10**18) // 10**9 for m in touching] == [0, 40]
    sparse = run([block], window_s=10.0, hop_s=45.0)
    assert [(m.start_ns - 10**18) // 10**9 for m in sparse] == [0, 45, 90]


def test_a_stream_shorter_than_a_window_is_read_and_flagged():
    (message,) = run([stream(30.0)], window_s=60.0)
    assert message.quality.flags == ("short_window",)
    assert len(message.modes) == 1


def test_a_break_in_a_stream_begins_a_new_window():
    messages = run([stream(50.0), stream(50.0, 7000, seed=1)], window_s=40.0)
    assert [(m.start_ns - 10**18) // 10**7 for m in messages] == [0, 7000]


def test_only_the_channels_asked_for_are_read():
    block = stream(60.0)
    other = 100 * np.sin(2 * np.pi * 2.0 * np.arange(6000) / 100)[:, None]
    both = dataclasses.replace(
        block,
        samples=np.hstack([other, block.samples]),
        channels=("motor", "beam"),
        units=("V", "g"),
    )
    (message,) = run([both], channels=("beam",))
    assert message.modes[0].frequency_hz.value == pytest.approx(5.0, rel=0.03)


@pytest.mark.long
def test_the_smoothed_frequency_stands_beside_the_measured_one_with_its_lag():
    blocks = [block for epoch in range(12) for block in STRUCTURE.epoch(epoch)]
    modes = [m.modes[0] for m in run(blocks, median_window=3, ewma_a=0.5) if m.modes]
    smoothed = [mode.smoothed_frequency_hz for mode in modes]
    assert smoothed[0].value == modes[0].frequency_hz.value
    assert smoothed[0].lag_epochs == 0.0
    assert smoothed[-1].lag_epochs == pytest.approx(1.0 + 1.0, abs=0.02)
    average = modes[0].frequency_hz.value
    values = [mode.frequency_hz.value for mode in modes]
    for n in range(1, len(modes)):
        average = 0.5 * float(np.median(values[max(0, n - 2) : n + 1])) + 0.5 * average
        assert smoothed[n].value == pytest.approx(average, rel=1e-12)
    assert smoothed[-1].sd < modes[-1].frequency_hz.sd
    assert run(blocks[:2], smooth=False)[0].modes[0].smoothed_frequency_hz is None


def test_an_epoch_without_end_is_cut_and_not_kept_in_memory():
    (block,) = STRUCTURE.epoch(0)
    blocks = [
        dataclasses.replace(
            block, first_index=n * 6000, start_ns=block.start_ns + n * 6 * 10**10
        )
        for n in range(5)
    ]
    (message,) = run(blocks, max_samples=12_500)
    assert message.quality.samples == 12_000


def test_a_failure_of_ours_is_flagged_and_costs_one_window_only(monkeypatch):
    real, calls = Tracker.step, []

    def sometimes(*given, **named):
        calls.append(1)
        if len(calls) == 2:
            raise ZeroDivisionError("a bug of ours")
        return real(*given, **named)

    monkeypatch.setattr(Tracker, "step", sometimes)
    messages = run([block for epoch in (0, 2, 3) for block in STRUCTURE.epoch(epoch)])
    assert [m.quality.flags for m in messages] == [(), ("failed",), ()]
    assert [len(m.modes) for m in messages] == [1, 0, 1]


def test_settings_that_contradict_themselves_say_so():
    with pytest.raises(ValidationError, match=r"upside down\. Give the lower frequency first"):
        ExtractSettings(band_hz=(9.0, 1.0))
    with pytest.raises(ValidationError, match=r"has no middle\. Give an odd number"):
        ExtractSettings(median_window=4)


def test_a_block_of_integers_is_read_as_it_is():
    (block,) = STRUCTURE.epoch(0)
    whole = dataclasses.replace(block, samples=np.round(block.samples * 1e4).astype("<i4"))
    real = dataclasses.replace(block, samples=np.round(block.samples * 1e4).astype("<f8"))
    assert isinstance(whole, Block)
    assert run([whole]) == run([real])


def heated(block, degrees):
    """The same, with a thermometer beside the accelerometer."""
    warm = degrees + 0.1 * np.sin(np.arange(len(block.samples)))
    return dataclasses.replace(
        block,
        samples=np.column_stack([block.samples.astype(float), warm]),
        channels=(*block.channels, "T deck"),
        units=("", ""),
        covariates={"load_kg": 7.0},
    )


def test_a_channel_may_tell_the_temperature_and_is_not_taken_for_a_vibration():
    (block,) = STRUCTURE.epoch(4)
    (plain,) = run([block])
    (message,) = run([heated(block, 21.5)], covariates={"temperature_c": "T deck"})
    assert message.covariates["temperature_c"] == pytest.approx(21.5, abs=0.01)
    assert message.covariates["load_kg"] == 7.0
    assert message.modes == plain.modes
    assert "no_covariate" not in message.quality.flags


def test_a_covariate_whose_channel_is_not_there_is_left_out_and_said_so():
    (block,) = STRUCTURE.epoch(4)
    (message,) = run([block], covariates={"temperature_c": "T deck"})
    assert message.covariates == {}
    assert message.quality.flags == ("no_covariate",)
    assert message.modes


def test_a_filter_that_takes_the_mean_off_is_refused_with_covariates():
    with pytest.raises(ValidationError, match="Leave highpass_hz out"):
        EdgeSettings(
            extract={"covariates": {"temperature_c": "T"}}, condition={"highpass_hz": 0.5}
        )
