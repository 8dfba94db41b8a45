"""At default settings 95 % intervals hold the truth in about 95 % of independent records."""

import numpy as np
import pytest

from slowtime.identification import ambient_law, first_mode, identify_ambient
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
