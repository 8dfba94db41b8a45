"""What is missing or stands out is bridged and counted; everything else passes untouched."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_agent.condition import CHUNK, Conditioner, Marked
from edge_agent.settings import ConditionSettings
from slowtime.signals.block import Block

RATE = 100.0


def block_of(samples, first_index=0, **more):
    samples = np.asarray(samples)
    samples = samples[:, None] if samples.ndim == 1 else samples
    names = tuple(f"c{i}" for i in range(samples.shape[1]))
    values = {
        "rate_hz": RATE,
        "start_ns": round(first_index * 1e9 / RATE),
        "channels": names,
        "units": ("m/s^2",) * len(names),
        **more,
    }
    return Block(samples=samples, first_index=first_index, **values)


def cut(block, where):
    edges = [0, *sorted(where), len(block.samples)]
    for first, last in itertools.pairwise(edges):
        yield dataclasses.replace(
            block,
            samples=block.samples[first:last],
            first_index=block.first_index + first,
            start_ns=block.start_ns + round(first * 1e9 / block.rate_hz),
        )


def run(stage, blocks):
    """Rows, marks and indices of all that comes out."""
    out: list[Marked] = []
    state = stage.start()
    for block in blocks:
        state, ready = stage.step(state, block)
        out += ready
    out += stage.finish(state)[1]
    rows = np.concatenate([block.samples for block, _ in out])
    marks = np.concatenate([marks for _, marks in out])
    index = np.concatenate([b.first_index + np.arange(len(b.samples)) for b, _ in out])
    return rows, marks, index


def vibration(count=1000, seed=1, channels=1, frequency=5.0):
    rng = np.random.default_rng(seed)
    t = np.arange(count) / RATE
    wave = np.sin(2 * np.pi * frequency * t)[:, None] * np.arange(1, channels + 1)
    return 3.0 + wave + 0.05 * rng.standard_normal((count, channels))


def spoilt():
    samples = vibration(1500, channels=2)
    samples[[100, 256, 700], [0, 1, 0]] += (8.0, -9.0, 7.0)
    samples[400:412] = np.nan
    samples[900, 1] = np.nan
    return block_of(samples)


WHOLE = spoilt()
STAGES = [
    ConditionSettings(),
    ConditionSettings(spikes=False),
    ConditionSettings(lowpass_hz=20.0, highpass_hz=0.5),
    ConditionSettings(decimate=3),
    ConditionSettings(max_gap_s=0.05),
]


@pytest.mark.parametrize("chosen", STAGES, ids=range(len(STAGES)))
@settings(max_examples=20, deadline=None)
@given(where=st.sets(st.integers(1, 1499), max_size=12))
def test_cutting_the_stream_anywhere_changes_nothing(chosen, where):
    stage = Conditioner(chosen)
    rows, marks, index = run(stage, cut(WHOLE, where))
    whole_rows, whole_marks, whole_index = run(stage, [WHOLE])
    np.testing.assert_array_equal(index, whole_index)
    np.testing.assert_allclose(rows, whole_rows, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(marks, whole_marks)


def test_the_input_is_not_written_into():
    before = WHOLE.samples.copy()
    run(Conditioner(ConditionSettings(lowpass_hz=20.0)), [WHOLE])
    np.testing.assert_array_equal(WHOLE.samples, before)


def test_spikes_and_missing_samples_are_bridged_counted_and_nothing_else_is_touched():
    clean = vibration(1500, channels=2)
    rows, marks, index = run(Conditioner(ConditionSettings()), [WHOLE])
    np.testing.assert_array_equal(index, np.arange(1500))
    assert np.flatnonzero(marks[:, 1]).tolist() == [100, 256, 700]
    assert marks[:, 0].sum() == 13
    touched = np.r_[100, 256, 700, 400:412, 900]
    others = np.setdiff1d(np.arange(1500), touched)
    np.testing.assert_array_equal(rows[others], clean[others])
    assert np.abs(rows[[100, 700], 0] - clean[[100, 700], 0]).max() < 0.4


@pytest.mark.parametrize("seed", range(8))
def test_nothing_stands_out_of_an_unspoilt_vibration(seed):
    rng = np.random.default_rng(seed)
    white = rng.standard_normal(4000)
    t = np.arange(4000) / RATE
    ringing = np.exp(-0.15 * 2 * np.pi * 5 * t) * np.cos(2 * np.pi * 5 * t)
    ringing += 1e-4 * rng.standard_normal(4000)
    beating = np.sin(2 * np.pi * 31 * t) * np.sin(2 * np.pi * 0.3 * t) + 0.01 * white
    for samples in (white, ringing, beating, vibration(4000, seed, frequency=24.0)):
        marks = run(Conditioner(ConditionSettings()), [block_of(samples)])[1]
        assert marks.sum() == 0


def test_a_spike_of_two_samples_goes_and_an_event_of_many_stays():
    samples = 0.01 * np.random.default_rng(0).standard_normal(1000)
    samples[300:302] += 5.0
    samples[600:620] += 5.0
    rows, marks, _ = run(Conditioner(ConditionSettings()), [block_of(samples)])
    assert np.flatnonzero(marks[:, 1]).tolist() == [300, 301]
    np.testing.assert_array_equal(rows[600:620, 0], samples[600:620])


def test_a_gap_in_the_index_is_bridged_if_short_and_parts_the_stream_if_long():
    samples = vibration(1000)
    stage = Conditioner(ConditionSettings(max_gap_s=0.2))
    short = [block_of(samples[:500]), block_of(samples[520:], 520)]
    rows, marks, index = run(stage, short)
    np.testing.assert_array_equal(index, np.arange(1000))
    assert marks[500:520, 0].tolist() == [1] * 20
    line = np.linspace(samples[499, 0], samples[520, 0], 22)[1:-1]
    np.testing.assert_allclose(rows[500:520, 0], line)
    long = [block_of(samples[:500]), block_of(samples[521:], 521)]
    rows, marks, index = run(stage, long)
    np.testing.assert_array_equal(index, np.r_[0:500, 521:1000])
    assert marks[:, 0].sum() == 0


def test_a_new_epoch_never_borrows_samples_from_the_one_before():
    samples = vibration(600)
    stage = Conditioner(ConditionSettings(lowpass_hz=10.0))
    blocks = [block_of(samples[:300], 0, epoch=0), block_of(samples[300:], 300, epoch=1)]
    together = run(stage, blocks)[0]
    apart = np.concatenate([run(stage, [block])[0] for block in blocks])
    np.testing.assert_array_equal(together, apart)


def test_decimation_keeps_the_band_the_times_and_the_offset():
    samples = vibration(3000, frequency=2.0)
    stage = Conditioner(ConditionSettings(decimate=5, spikes=False))
    out: list[Marked] = []
    state = stage.start()
    for block in cut(block_of(samples, first_index=7), {501, 502, 1900}):
        state, ready = stage.step(state, block)
        out += ready
    out += stage.finish(state)[1]
    blocks = [block for block, _ in out]
    assert {block.rate_hz for block in blocks} == {20.0}
    index = np.concatenate([b.first_index + np.arange(len(b.samples)) for b in blocks])
    np.testing.assert_array_equal(index, np.arange(2, 2 + len(index)))
    assert all(abs(b.start_ns - b.first_index * 50_000_000) <= 1 for b in blocks)
    rows = np.concatenate([block.samples for block in blocks])[100:, 0]
    assert rows.mean() == pytest.approx(3.0, abs=0.02)
    assert rows.std() * np.sqrt(2) == pytest.approx(1.0, abs=0.03)


def test_an_offset_does_not_ring_through_the_filter():
    samples = np.full(1000, 50.0)
    stage = ConditionSettings(highpass_hz=1.0, spikes=False)
    assert np.abs(run(Conditioner(stage), [block_of(samples)])[0]).max() < 1e-9


def test_whole_numbers_and_single_precision_are_taken_as_they_come():
    samples = np.round(vibration(800) * 1000)
    wanted = run(Conditioner(ConditionSettings()), [block_of(samples)])[0]
    for kind in ("<i2", "<i4", "<f4"):
        got = run(Conditioner(ConditionSettings()), [block_of(samples.astype(kind))])[0]
        np.testing.assert_array_equal(got, wanted)


def test_a_band_above_nyquist_says_what_to_change():
    with pytest.raises(
        ValueError, match=r"not below 50 Hz.*Lower lowpass_hz, or sample faster"
    ):
        run(Conditioner(ConditionSettings(lowpass_hz=60.0)), [WHOLE])


def test_the_state_holds_no_more_than_a_chunk_and_its_margins():
    stage = Conditioner(ConditionSettings())
    state = stage.start()
    for number in range(200):
        state, _ = stage.step(state, block_of(vibration(100, number), 100 * number))
        assert state is not None
        assert len(state.rows) < 2 * CHUNK + 200
