import dataclasses
import functools
import pickle

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.dynamics.simulation import ambient_structure
from slowtime.dynamics.structure import Structure
from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.recursive import RecursiveModes
from slowtime.identification.recursive.forgetting import FrequencyGrid
from slowtime.identification.recursive.frames import BinRange
from slowtime.identification.recursive.product_sums import MOST, ProductSum, ProductSums
from slowtime.identification.subspace.correlations import block_products

RATE = 16.0
FREQUENCIES = np.array([2.0, 2.6, 4.05])
HEARD = FREQUENCIES[:2]
DAMPING = 0.015
RECURSIVE = RecursiveModes(rate_hz=RATE, band_hz=(1.7, 3.2), every_s=1450.0)


def structure(frequencies_hz=FREQUENCIES):
    """Unit masses in a row with the frequencies given, all modes damped alike."""
    number = len(frequencies_hz)
    stiffness = 2 * np.eye(number) - np.eye(number, k=1) - np.eye(number, k=-1)
    stiffness[-1, -1] = 1.0
    shapes = scipy.linalg.eigh(stiffness)[1]
    omega = 2 * np.pi * np.asarray(frequencies_hz)
    whole = Structure(
        mass=np.eye(number),
        damping=shapes * (2 * DAMPING * omega) @ shapes.T,
        stiffness=shapes * omega**2 @ shapes.T,
    )
    return whole, shapes


@functools.cache
def record(seed=1, seconds=1600):
    rng = np.random.default_rng(seed)
    motion = ambient_structure(structure()[0], round(seconds * RATE), RATE, rng)
    return motion + 0.1 * motion.std(axis=0) * rng.standard_normal(motion.shape)


def run(recursive, blocks, state=None):
    state = state or recursive.start()
    modes = ()
    for block in blocks:
        state, modes = recursive.step(state, block)
    return state, modes


@functools.cache
def told():
    return run(RECURSIVE, [record()])[1]


def same(one, other):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert a.frequency_hz == b.frequency_hz
        assert a.damping_ratio == b.damping_ratio
        np.testing.assert_array_equal(a.shape, b.shape)
        np.testing.assert_array_equal(a.shape_sd, b.shape_sd)


def apart(ours, theirs):
    """Differences of frequency and damping, in standard deviations of theirs."""
    return [
        (one.value - other.value) / other.sd
        for one, other in (
            (ours.frequency_hz, theirs.frequency_hz),
            (ours.damping_ratio, theirs.damping_ratio),
        )
    ]


@pytest.mark.long
def test_modes_of_a_stream_are_those_of_the_whole_record_within_their_standard_deviations():
    samples = record(seconds=6000)
    recursive = dataclasses.replace(RECURSIVE, every_s=5900.0)
    _, modes = run(recursive, np.split(samples, 60))
    batch = identify_modes(samples, RATE, band_hz=RECURSIVE.band_hz).structural
    assert len(modes) == len(batch) == 2
    away = [apart(ours, theirs) for ours, theirs in zip(modes, batch, strict=True)]
    assert np.sqrt(np.mean(np.square(away))) < 1.0
    for ours, theirs in zip(modes, batch, strict=True):
        assert ours.frequency_hz.sd < 1.25 * theirs.frequency_hz.sd
        assert mac(ours.shape, theirs.shape) > 0.9995


@pytest.mark.slow
def test_stream_and_record_agree_and_intervals_hold_over_many_records():
    recursive = dataclasses.replace(RECURSIVE, every_s=3900.0)
    away, errors, false = [], [], 0
    for seed in range(40):
        samples = record(seed, 4000)
        _, modes = run(recursive, [samples])
        batch = identify_modes(samples, RATE, band_hz=RECURSIVE.band_hz).structural
        false += len(modes) - 2
        for ours, theirs, true_hz in zip(modes, batch, HEARD, strict=True):
            away.append(apart(ours, theirs))
            of_frequency = (ours.frequency_hz.value - true_hz) / ours.frequency_hz.sd
            of_damping = (ours.damping_ratio.value - DAMPING) / ours.damping_ratio.sd
            errors.append((of_frequency, of_damping))
    assert false == 0
    assert np.sqrt(np.mean(np.square(away))) < 0.8
    assert np.mean(np.abs(away) < 1.0) > 0.85
    assert (np.mean(np.abs(errors) < 1.96, axis=0) > 0.88).all()
    assert (np.std(errors, axis=0) > 0.75).all()


def test_truth_lies_where_the_modes_say():
    for mode, true_hz, shape in zip(told(), HEARD, structure()[1].T[:2], strict=True):
        assert abs(mode.frequency_hz.value - true_hz) < 3 * mode.frequency_hz.sd
        assert abs(mode.damping_ratio.value - DAMPING) < 3 * mode.damping_ratio.sd
        away = mode.shape - shape * np.vdot(shape, mode.shape)
        assert np.linalg.norm(away) < 3 * np.linalg.norm(mode.shape_sd)
        assert mode.kind == "structural"


@settings(max_examples=3, deadline=None)
@given(where=st.sets(st.integers(1, 25_599), max_size=12))
def test_cutting_the_stream_anywhere_changes_nothing(where):
    same(run(RECURSIVE, np.split(record(), sorted(where)))[1], told())


def test_a_state_that_was_pickled_goes_on_as_if_it_had_not_been():
    before, after = np.split(record(), [11_111])
    kept = pickle.dumps(run(RECURSIVE, [before])[0])
    same(run(RECURSIVE, [after], pickle.loads(kept))[1], told())


def test_samples_that_are_used_again_by_their_owner_do_no_harm():
    buffer = np.empty((160, 3))
    state = RECURSIVE.start()
    for at in range(0, len(record()), 160):
        buffer[:] = record()[at : at + 160]
        state, modes = RECURSIVE.step(state, buffer)
    same(modes, told())


def test_a_gap_costs_what_it_falls_into_and_joins_nothing_that_is_apart():
    with_gap = record().copy()
    with_gap[9_000:9_030, 1] = np.nan
    state, modes = run(RECURSIVE, np.split(with_gap, 40))
    assert state.lost == 30
    for mode, unhurt, true_hz in zip(modes, told(), HEARD, strict=True):
        assert abs(mode.frequency_hz.value - true_hz) < 3 * mode.frequency_hz.sd
        assert mode.frequency_hz.sd < 1.2 * unhurt.frequency_hz.sd


def test_lost_samples_that_are_only_counted_are_the_same_as_samples_that_are_not_numbers():
    with_gap = record().copy()
    with_gap[9_000:9_030] = np.nan
    one = run(RECURSIVE, [with_gap])
    state, _ = RECURSIVE.step(RECURSIVE.start(), record()[:9_000])
    state, modes = RECURSIVE.step(state, record()[9_030:], first_index=9_030)
    same(modes, one[1])
    assert state.lost == one[0].lost == 30


def test_a_stream_with_many_gaps_still_tells_its_modes():
    holes = record().copy()
    holes[4_000::4_000] = np.nan
    recursive = dataclasses.replace(RECURSIVE, every_s=900.0)
    assert [round(mode.frequency_hz.value, 1) for mode in run(recursive, [holes])[1]] == [
        2.0,
        2.6,
    ]


@pytest.mark.long
def test_what_is_forgotten_has_no_say_and_what_is_not_has():
    seconds = 1600
    later = ambient_structure(
        structure(0.97 * FREQUENCIES)[0],
        round(seconds * RATE),
        RATE,
        np.random.default_rng(2),
    )
    forgetful = dataclasses.replace(RECURSIVE, memory_s=300.0)
    stream = [record(), later]
    _, modes = run(forgetful, stream)
    assert len(modes) == 2
    for mode, true_hz in zip(modes, 0.97 * HEARD, strict=True):
        assert abs(mode.frequency_hz.value - true_hz) < 4 * mode.frequency_hz.sd
    lower = [mode.frequency_hz for mode in run(RECURSIVE, stream)[1]][:-1]
    assert any(abs(hz.value - 0.97 * FREQUENCIES[0]) > 8 * hz.sd for hz in lower)


def test_a_memory_of_half_the_length_has_larger_errors():
    wide = told()[1].frequency_hz.sd
    short = run(dataclasses.replace(RECURSIVE, memory_s=200.0), [record()])[1]
    # A memory of 200 s holds 400 s of record of even weight, and the stream 1,600 s.
    assert 1.5 < short[1].frequency_hz.sd / wide < 2.7


def test_the_line_of_a_machine_is_told_as_one_and_hurts_no_mode():
    seconds = np.arange(len(record())) / RATE
    fan = 0.6 * np.sin(2 * np.pi * 2.75 * seconds)[:, None] * np.array([1.0, 0.5, 0.8])
    _, modes = run(RECURSIVE, [record() + record().std(axis=0) * fan])
    kinds = {round(mode.frequency_hz.value, 2): mode.kind for mode in modes}
    assert kinds.pop(2.75) == "harmonic"
    assert set(kinds.values()) == {"structural"}
    structural = [mode for mode in modes if mode.kind == "structural"]
    for mode, unhurt in zip(structural, told(), strict=True):
        away = mode.frequency_hz.value - unhurt.frequency_hz.value
        assert abs(away) < 1.5 * unhurt.frequency_hz.sd
        away = mode.damping_ratio.value - unhurt.damping_ratio.value
        assert abs(away) < 1.5 * unhurt.damping_ratio.sd


def test_noise_without_modes_tells_of_none():
    noise = np.random.default_rng(5).standard_normal((25_600, 3))
    assert run(RECURSIVE, [noise])[1] == ()


def test_shapes_cover_channels_that_are_more_than_the_combinations_looked_at():
    narrow = dataclasses.replace(RECURSIVE, most_directions=2, band_hz=(1.7, 2.4))
    units = np.array([1.0, 1e-3, 50.0])
    _, modes = run(narrow, [record() * units])
    found = modes[0].shape / units
    assert mac(found, structure()[1][:, 0]) > 0.9995


def test_a_dead_channel_is_left_out_of_the_shapes():
    silent = np.concatenate([record(), np.zeros((len(record()), 1))], axis=1)
    _, modes = run(RECURSIVE, [silent])
    for mode, without in zip(modes, told(), strict=True):
        assert mode.shape[3] == 0
        assert mode.shape_sd[3] == 0
        assert mode.frequency_hz.value == pytest.approx(without.frequency_hz.value, rel=1e-6)


def test_neither_memory_nor_the_work_of_a_block_grows_with_the_stream():
    quick = dataclasses.replace(RECURSIVE, every_s=1e9)
    sizes, kept = [], []
    state = quick.start()
    for _ in range(12):
        state, _ = run(quick, np.split(record(), 4), state)
        sizes.append(len(pickle.dumps(state)))
        kept.append(max(len(band.sums.whole) for band in state.bands))
    assert max(sizes) < 1.5 * sizes[1]
    assert max(kept) < MOST


def test_a_frame_moves_its_band_to_zero_without_seams():
    frame = BinRange.of(RECURSIVE.bands[1], RATE)
    tone = 2.3
    times = np.arange(20 * frame.hop) / RATE
    wave = np.cos(2 * np.pi * tone * times)[:, None]
    slow = np.concatenate(
        [
            frame.moved_to_zero(wave[k * frame.hop : k * frame.hop + frame.length], k)
            for k in range(18)
        ]
    )
    begin = times[frame.length // 4]
    instants = begin + np.arange(len(slow)) / frame.rate_hz
    expected = 0.5 * np.exp(2j * np.pi * (tone * instants - frame.centre_hz * (instants)))
    gain = frame.band.gain(np.array([tone]))[0]
    np.testing.assert_allclose(slow[:, 0], gain * expected, atol=1e-3)


def test_a_window_that_fades_adds_just_its_decay_to_a_mode():
    raster = FrequencyGrid(BinRange.of(RECURSIVE.bands[1], RATE))
    rate = raster.frame.rate_hz
    into = np.ones((1, 1), dtype=complex)
    rng = np.random.default_rng(3)
    pole = -0.05 + 0.3j
    total = np.zeros(len(raster.frequency_hz))
    for _ in range(3):
        fading = raster.start(1, 1)
        force = rng.standard_normal(60_000) + 1j * rng.standard_normal(60_000)
        series = scipy.signal.lfilter([1.0], [1.0, -np.exp(pole / rate)], force)
        for part in np.split(series, 600):
            fading = raster.step(fading, part[:, None], into, None)
        total += fading.powers[:, 0] / fading.weight
    offset = 2 * np.pi * (raster.frequency_hz - raster.frame.centre_hz)
    wide = -pole.real + raster.decay
    expected = wide / ((offset - pole.imag) ** 2 + wide**2)
    ratio = total / expected
    near = np.abs(offset - pole.imag) < 3 * wide
    assert ratio[near].std() / ratio[near].mean() < 0.2
    half = np.abs(np.abs(offset - pole.imag) - wide) < 0.3 * wide
    top = np.abs(offset - pole.imag) < 0.3 * wide
    assert ratio[half].mean() / ratio[top].mean() == pytest.approx(1.0, abs=0.15)


def test_sums_of_stretches_are_those_of_the_whole_series():
    rng = np.random.default_rng(4)
    series = rng.standard_normal((2_003, 2)) + 1j * rng.standard_normal((2_003, 2))
    sums = ProductSums()
    for at in range(0, 2_000, 10):
        part = block_products(series[at : at + 13], series[at : at + 13], lags=4, length=10)
        sums = sums.added(ProductSum(part[0], 10.0, float(at)), None)
    found = sums.correlations(rate_hz=1.0, centre_hz=0.0, memory_s=None)
    assert found is not None
    assert found.duration_s == 2_000
    for lag in range(4):
        direct = series[lag : lag + 2_000].T @ series[:2_000].conj() / 2_000
        np.testing.assert_allclose(found.mean[lag], direct, atol=2e-6)


def test_hopeless_settings_and_samples_out_of_order_are_refused_with_the_cure():
    with pytest.raises(ValueError, match=r"band_hz=\(1, 9\) is not a band between 0 and 7.84"):
        RecursiveModes(rate_hz=RATE, band_hz=(1.0, 9.0))
    with pytest.raises(ValueError, match=r"memory_s=10 holds 16 cycles.*at least 31.25 s"):
        RecursiveModes(rate_hz=RATE, band_hz=(1.6, 5.0), memory_s=10.0)
    state, _ = RECURSIVE.step(RECURSIVE.start(), record()[:100])
    with pytest.raises(ValueError, match=r"index 50 was given after 100.*in order"):
        RECURSIVE.step(state, record()[:10], first_index=50)
    with pytest.raises(ValueError, match=r"2 channels.*after blocks of 3.*Start anew"):
        RECURSIVE.step(state, record()[:10, :2])


@pytest.mark.parametrize("band_hz", [(1.9, 2.1), (1.6, 3.9), (0.9, 7.0)])
def test_a_mode_does_not_depend_on_the_edges_of_the_band(band_hz):
    recursive = dataclasses.replace(RECURSIVE, band_hz=band_hz)
    found = run(recursive, [record()])[1]
    assert all(band_hz[0] <= mode.frequency_hz.value <= band_hz[1] for mode in found)
    wanted = [m for m in told() if band_hz[0] <= m.frequency_hz.value <= band_hz[1]]
    assert wanted
    for mode in wanted:
        near = min(found, key=lambda m: abs(m.frequency_hz.value - mode.frequency_hz.value))
        assert np.abs(apart(near, mode)).max() <= 0.5
