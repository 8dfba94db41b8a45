"""At default settings 95 % intervals hold the truth in about 95 % of independent records."""

import numpy as np
import pytest

from slowtime.identification import ambient_law, first_mode, identify_ambient
from slowtime_services.board import Board
from tests.slowtime.identification.oscillators import drawn, record

PLAIN = {"f": 4.0, "z": 0.02, "rate": 200.0, "seconds": 60.0, "noise": 0.01}


def scores(found, case):
    """Standard scores of frequency and damping, and damping relative to the truth."""
    f, z = found.frequency_hz, found.damping_ratio
    return (f.value - case["f"]) / f.sd, (z.value - case["z"]) / z.sd, z.value / case["z"]


def test_a_plain_record_needs_no_band_for_its_intervals_to_hold():
    rng = np.random.default_rng(1)
    found = np.array(
        [scores(identify_ambient(record(rng, **PLAIN), 200.0), PLAIN) for _ in range(16)]
    )
    # Of 16 intervals of 95 % fewer than 13 hold with probability 0.4 %.
    assert np.sum(np.abs(found[:, 0]) < 1.96) >= 13
    assert np.sum(np.abs(found[:, 1]) < 1.96) >= 13
    assert np.abs(found[:, :2]).max() < 4.5
    # 2 pi zeta f T = 30: a second-order bias of 3 %, and a scatter of 18 % / 4.
    assert 0.88 < found[:, 2].mean() < 1.2


@pytest.mark.parametrize("motion", ["displacement", "velocity", "acceleration"])
def test_what_was_measured_does_not_matter(motion):
    rng = np.random.default_rng(2)
    case = PLAIN | {"seconds": 200.0, "rate": 50.0}
    found = first_mode(record(rng, **case, motion=motion), 50.0)
    assert found is not None
    assert found.method == "ambient"
    of_f, of_z, _ = scores(found, case)
    assert max(abs(of_f), abs(of_z)) < 3.5


def test_a_record_of_few_half_bandwidths_says_that_its_damping_is_hardly_known():
    rng = np.random.default_rng(3)
    case = PLAIN | {"f": 1.5, "z": 0.005, "rate": 50.0}
    for _ in range(4):
        found = identify_ambient(record(rng, **case), 50.0)
        assert "few_cycles" in found.flags
        assert abs(found.damping_ratio.value - 0.005) < 3.0 * found.damping_ratio.sd


def test_several_channels_that_move_together_hold_as_well():
    rng = np.random.default_rng(4)
    case = PLAIN | {"seconds": 300.0, "rate": 50.0, "noise": 0.2}
    found = np.array(
        [
            scores(identify_ambient(record(rng, **case, channels=3), 50.0), case)
            for _ in range(8)
        ]
    )
    assert np.abs(found[:, :2]).max() < 3.5
    assert np.sum(np.abs(found[:, :2]) < 1.96) >= 12


@pytest.mark.slow
def test_five_hundred_drawn_records_hold_their_intervals():
    rng = np.random.default_rng(5)
    rows = []
    for run in range(500):
        case = drawn(rng, 3e5)
        channels = (1, 1, 3)[run % 3]
        filtered = ("chebyshev", "butterworth")[run % 2]
        made = record(rng, **case, channels=channels, filtered=filtered)
        found = first_mode(made, case["rate"])
        assert found is not None
        half_widths = 2 * np.pi * case["z"] * case["f"] * case["seconds"]
        if half_widths < 20:
            assert "few_cycles" in found.flags
        of_f, of_z, ratio = scores(found, case)
        law = ambient_law(case["z"], case["f"] * case["seconds"])
        off = found.frequency_hz.value / case["f"] - 1
        rows.append((of_f, of_z, ratio, half_widths, off / law[0], (ratio - 1) / law[1]))
    table = np.array(rows)
    within = np.mean(np.abs(table[:, :2]) < 1.96, axis=0)
    assert np.all((within > 0.92) & (within < 0.97))
    assert np.abs(table[:, :2]).max() < 4.5
    lawful = table[table[:, 3] >= 50]
    assert np.mean(lawful[:, 2] - 1 / lawful[:, 3]) == pytest.approx(1.0, abs=0.03)
    assert np.all(np.sqrt(np.mean(lawful[:, 4:] ** 2, axis=0)) < 1.15)


@pytest.mark.long
def test_a_random_response_seen_for_a_few_times_its_memory_is_not_read_as_a_decay():
    """20 s at 3.2 Hz and 1 %: four times the memory; the noise is 30 dB below the motion."""
    readings = Board(rate_hz=125.0, frequency_hz=3.2, damping_ratio=0.01).readings(
        2_500, np.random.default_rng(5)
    )
    found = [first_mode(next(readings).counts[:, :2].astype(float), 125.0) for _ in range(24)]
    modes = [mode for mode in found if mode is not None]
    assert len(modes) >= 22
    assert sum(mode.method == "free_decay" for mode in modes) <= 2
    frequency = np.array([(m.frequency_hz.value - 3.2) / m.frequency_hz.sd for m in modes])
    damping = np.array([(m.damping_ratio.value - 0.01) / m.damping_ratio.sd for m in modes])
    # Of 24 intervals of 95 %, fewer than 19 hold with probability 0.2 %.
    assert np.sum(np.abs(frequency) < 1.96) >= 19
    assert np.sum(np.abs(damping) < 1.96) >= 19
    for mode in modes:
        memories = 2 * np.pi * mode.damping_ratio.value * mode.frequency_hz.value * 20.0
        if mode.method == "ambient" and memories < 1.0:
            assert mode.damping_ratio.sd > 0.5 / (mode.frequency_hz.value * 20.0)
