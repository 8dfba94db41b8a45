"""Input-output subspaces under strong, unsteady motion of two supports."""

import numpy as np
import pytest
import scipy.signal

from slowtime.identification.subspace.input_output import input_output_poles
from slowtime.identification.subspace.stabilisation import find_stable_poles
from tests.slowtime.identification.modal_fit.structures import Structure, frame, response_to

FRAME = frame(3)
BUILDING = Structure(
    np.array([1.2, 3.5, 5.6]), np.array([0.03, 0.025, 0.03]), FRAME.shapes, FRAME.shapes[[2]]
)
SUPPORTS = np.stack([0.6 * FRAME.shapes.sum(axis=0), 0.4 * FRAME.shapes.sum(axis=0) + 0.03])
RATE = 50.0


def record(seed, *, quake, noise=0.02):
    rng = np.random.default_rng(seed)
    time = np.arange(3000) / RATE
    sections = scipy.signal.butter(6, 18, fs=RATE, output="sos")
    ground = scipy.signal.sosfilt(sections, rng.standard_normal((3000, 2)), axis=0)
    if quake:
        ground *= (time / 8 * np.exp(1 - time / 8))[:, None]
    y = response_to(BUILDING, ground, RATE, factors=SUPPORTS)
    return ground, y + noise * rng.standard_normal(y.shape)


def nearest(seed, *, quake, rate=RATE):
    ground, y = record(seed, quake=quake)
    poles = input_output_poles(ground, y, rate, highest_hz=9.0)
    found = find_stable_poles(poles, low_hz=0.4, high_hz=9.0)
    return [
        min(found, key=lambda one: abs(one.frequency_hz - f)) for f in BUILDING.frequency_hz
    ]


@pytest.mark.parametrize("quake", [False, True])
def test_all_modes_are_found_within_their_errors(quake):
    for k, one in enumerate(nearest(1, quake=quake)):
        assert abs(one.frequency_hz - BUILDING.frequency_hz[k]) < 4.5 * one.frequency_sd_hz
        assert abs(one.damping_ratio - BUILDING.damping_ratio[k]) < 4.5 * one.damping_sd
        assert one.frequency_sd_hz < 0.02 * one.frequency_hz
        true = BUILDING.shapes[:, k] / np.linalg.norm(BUILDING.shapes[:, k])
        assert abs(np.vdot(true, one.shape)) ** 2 > 0.98


def test_a_short_record_is_refused():
    ground, y = record(2, quake=False)
    with pytest.raises(ValueError, match=r"are too few for .* Give a longer record"):
        input_output_poles(ground[:300], y[:300], RATE, highest_hz=9.0)


@pytest.mark.long
@pytest.mark.parametrize("quake", [False, True])
def test_intervals_hold_over_seeds(quake):
    deviations = [
        [
            (one.frequency_hz - BUILDING.frequency_hz[k]) / one.frequency_sd_hz,
            (one.damping_ratio - BUILDING.damping_ratio[k]) / one.damping_sd,
        ]
        for seed in range(40)
        for k, one in enumerate(nearest(seed, quake=quake))
        if abs(one.frequency_hz / BUILDING.frequency_hz[k] - 1) < 0.1
    ]
    assert len(deviations) > 115
    covered = (np.abs(deviations) < 1.96).mean(axis=0)
    assert covered.min() > 0.91
