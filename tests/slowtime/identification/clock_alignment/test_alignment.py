import dataclasses

import numpy as np
import pytest

from slowtime.identification.clock_alignment.alignment import align, align_all
from slowtime.identification.clock_alignment.boards import BoardRecord
from slowtime.identification.clock_alignment.clock_offset import ClockPrior
from tests.slowtime.identification.clock_alignment.boards import Structure, motion

RATE_HZ, SECONDS, BAND_HZ = 100.0, 120.0, (1.0, 20.0)
OFFSET_S, DRIFT = 0.02, 50e-6


def two_boards(seed, *, structure=None, noise=0.03, start_sd_s=0.02):
    """Three places each; the second board's clock is wrong by `OFFSET_S` and `DRIFT`."""
    rng = np.random.default_rng(seed)
    structure = structure or Structure(shapes=rng.normal(size=(6, 3)))
    moved = motion(rng, structure, SECONDS, 60.0)
    count = int(RATE_HZ * SECONDS)
    one = moved.sampled(RATE_HZ, 1.0, count)[:, :3]
    two = moved.sampled(RATE_HZ * (1 + DRIFT), 1.0 + OFFSET_S, count)[:, 3:]
    one, two = (x + noise * x.std() * rng.normal(size=x.shape) for x in (one, two))
    return (
        BoardRecord(samples=one, channels=("a", "b", "c"), rate_hz=RATE_HZ, start_s=1.0),
        BoardRecord(
            samples=two,
            channels=("d", "e", "f"),
            rate_hz=RATE_HZ,
            rate_sd=1e-4,
            start_s=1.0,
            start_sd_s=start_sd_s,
        ),
    )


def _in_band(samples):
    """Size of what lies between 1 and 12 Hz, where the modes are."""
    frequency = np.fft.rfftfreq(len(samples), 1 / RATE_HZ)
    inside = (frequency > 1.0) & (frequency < 12.0)
    return np.linalg.norm(np.fft.rfft(samples, axis=0)[inside], axis=0)


def clock(seconds, start_s=0.0, rate_sd=0.0, start_sd_s=0.0):
    """A board of one channel at rest, sampled once a second."""
    return BoardRecord(
        samples=np.zeros((seconds + 1, 1)),
        channels=("a",),
        rate_hz=1.0,
        rate_sd=rate_sd,
        start_s=start_s,
        start_sd_s=start_sd_s,
    )


@pytest.mark.parametrize(("begins", "swapped"), [(0.0, False), (0.0, True), (-40.0, False)])
def test_the_clocks_say_of_the_offset_what_drawn_clocks_scatter_by(begins, swapped):
    """An error of the rate adds up from a board's own first sample to the common middle."""
    boards = (
        clock(100, begins, rate_sd=2e-3, start_sd_s=0.05),
        clock(160, 20.0, rate_sd=5e-3, start_sd_s=0.02),
    )
    prior = ClockPrior.of(*(reversed(boards) if swapped else boards))
    assert prior is not None
    middle = (20.0 + begins + 100.0) / 2
    assert prior.middle_s == pytest.approx(middle)
    rng = np.random.default_rng(4)
    read = [
        board.start_s
        + board.start_sd_s * rng.standard_normal(40_000)
        + (middle - board.start_s) * (1 + board.rate_sd * rng.standard_normal(40_000))
        for board in boards
    ]
    assert prior.offset_sd_s == pytest.approx(np.std(read[1] - read[0]), rel=0.02)
    assert prior.drift_sd == pytest.approx(np.hypot(2e-3, 5e-3))


def test_offset_and_drift_are_found_within_their_errors():
    found = align(*two_boards(0), band_hz=BAND_HZ)
    assert found.merged is not None, found.sentence
    assert found.offset_s is not None
    assert found.drift is not None
    assert abs(found.offset_s.value - OFFSET_S) < 3.5 * found.offset_s.sd < 0.01
    assert abs(found.drift.value - DRIFT) < 3.5 * found.drift.sd < 1e-4
    assert found.sentence.startswith("Aligned: the second board starts +")
    assert len(found.evidence) == 3


def test_merged_channels_are_what_one_board_would_have_recorded():
    structure = Structure(shapes=np.random.default_rng(5).normal(size=(6, 3)))
    first, second = two_boards(1, structure=structure, noise=0.0)
    merged = align(first, second, band_hz=BAND_HZ).merged
    assert merged is not None
    rng = np.random.default_rng(1)
    moved = motion(rng, structure, SECONDS, 60.0)
    whole = moved.sampled(RATE_HZ, merged.start_s, len(merged.samples))
    inner = slice(100, -100)
    error, size = (_in_band(x[inner]) for x in (merged.samples - whole, whole))
    np.testing.assert_allclose(error[:3] / size[:3], 0.0, atol=1e-9)
    # An error of 0.5 ms is 0.03 rad at the highest mode.
    assert (error[3:] / size[3:]).max() < 0.05
    assert merged.channels == ("a", "b", "c", "d", "e", "f")


def test_boards_of_two_structures_stay_apart():
    first, _ = two_boards(2)
    _, second = two_boards(3)
    found = align(first, second, band_hz=BAND_HZ)
    assert found.merged is None
    assert "no mode is seen by both boards in common motion" in found.sentence


def test_one_mode_and_a_vague_start_are_ambiguous():
    alone = Structure(frequency_hz=(9.7,), shapes=np.ones((6, 1)))
    found = align(*two_boards(4, structure=alone, start_sd_s=0.2), band_hz=BAND_HZ)
    assert found.merged is None
    assert "half periods apart" in found.sentence


def test_records_of_different_times_are_not_aligned():
    first, second = two_boards(6)
    found = align(first, dataclasses.replace(second, start_s=500.0))
    assert found.merged is None
    assert "did not record at the same time" in found.sentence


def test_boards_of_unlike_rates_meet_on_the_faster_grid():
    first, second = two_boards(7)
    halved = dataclasses.replace(first, samples=first.samples[::2], rate_hz=RATE_HZ / 2)
    found = align(halved, second, band_hz=(1.0, 12.0))
    assert found.merged is not None, found.sentence
    assert found.merged.rate_hz == pytest.approx(RATE_HZ, rel=1e-3)


def test_what_is_given_is_left_as_it_was():
    first, second = two_boards(8)
    before = first.samples.copy(), second.samples.copy()
    align(first, second, band_hz=BAND_HZ)
    np.testing.assert_array_equal(before[0], first.samples)
    np.testing.assert_array_equal(before[1], second.samples)


def test_a_third_board_that_moves_otherwise_is_left_out():
    first, second = two_boards(9)
    stranger = dataclasses.replace(two_boards(10)[1], channels=("x", "y", "z"))
    whole, said = align_all((first, stranger, second), band_hz=BAND_HZ)
    assert whole.channels == (*first.channels, *second.channels)
    assert [found.merged is None for found in said] == [True, False]


@pytest.mark.slow
def test_offsets_hold_within_their_intervals_as_often_as_they_say():
    far = []
    for seed in range(100):
        found = align(*two_boards(seed), band_hz=BAND_HZ)
        if found.merged is not None and found.offset_s is not None:
            far.append((found.offset_s.value - OFFSET_S) / found.offset_s.sd)
    assert len(far) > 80
    assert np.mean(np.abs(far) < 1.96) > 0.91


def test_the_spread_of_an_offset_is_that_of_clocks_drawn_at_random():
    """Each clock starts and runs wrong by chance; the offset is read where both have run."""
    rng = np.random.default_rng(5)
    boards = [
        BoardRecord(
            samples=np.zeros((1001, 1)), channels=("x",), rate_hz=10.0, rate_sd=rate_sd,
            start_s=start_s, start_sd_s=start_sd_s,
        )
        for start_s, start_sd_s, rate_sd in ((0.0, 1e-3, 4e-5), (30.0, 2e-3, 9e-5))
    ]  # fmt: skip
    prior = ClockPrior.of(*boards)
    assert prior is not None
    assert prior.middle_s == 65.0
    wrong = [
        board.start_sd_s * rng.standard_normal(200_000)
        + board.rate_sd * rng.standard_normal(200_000) * (prior.middle_s - board.start_s)
        for board in boards
    ]
    assert prior.offset_sd_s == pytest.approx((wrong[1] - wrong[0]).std(), rel=0.01)
