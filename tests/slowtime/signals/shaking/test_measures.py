"""Peaks, energy and duration against closed forms; guideline values against the standard."""

import numpy as np
import pytest

from slowtime.signals.shaking.guideline_values import guideline_value
from slowtime.signals.shaking.measures import event_measures, motion_of

RATE, F = 400.0, 6.0
TIME = np.arange(0, 20, 1 / RATE)
ENVELOPE = np.exp(-(((TIME - 10) / 1.5) ** 2))
DISPLACEMENT = 2e-3 * ENVELOPE * np.sin(2 * np.pi * F * TIME)
VELOCITY = np.gradient(DISPLACEMENT, TIME)
ACCELERATION = np.gradient(VELOCITY, TIME)


@pytest.mark.parametrize(
    ("order", "samples"), [(0, DISPLACEMENT), (1, VELOCITY), (2, ACCELERATION + 9.81)]
)
def test_each_kind_of_motion_gives_the_others(order, samples):
    found = motion_of(samples[:, None], RATE, 0.2, order)
    for one, truth in zip(found, (ACCELERATION, VELOCITY, DISPLACEMENT), strict=True):
        assert np.abs(one[:, 0] - truth).max() < 0.005 * np.abs(truth).max()


def test_measures_of_a_burst_with_known_integrals():
    found = event_measures(motion_of(ACCELERATION[:, None], RATE, 0.2, 2), RATE)
    omega = 2 * np.pi * F
    assert found.peak_displacement[0] == pytest.approx(2e-3, rel=0.01)
    assert found.peak_velocity[0] == pytest.approx(2e-3 * omega, rel=0.01)
    assert found.peak_acceleration[0] == pytest.approx(2e-3 * omega**2, rel=0.01)
    assert found.frequency_hz[0] == pytest.approx(F, rel=0.01)
    assert found.peak_time_s[0] == pytest.approx(10, abs=1 / F)
    # The squared envelope is normal with variance 1.5² / 4: 5 to 95 % are 2 x 1.645 of its sd.
    assert found.duration_s[0] == pytest.approx(2 * 1.645 * 1.5 / 2, rel=0.02)
    energy = (2e-3 * omega**2) ** 2 / 2 * 1.5 * np.sqrt(np.pi / 2)
    assert found.arias_intensity[0] == pytest.approx(np.pi / (2 * 9.80665) * energy, rel=0.01)
    absolute = 2e-3 * omega**2 * 2 / np.pi * 1.5 * np.sqrt(np.pi)
    assert found.cumulative_absolute_velocity[0] == pytest.approx(absolute, rel=0.01)


def test_half_wave_that_the_record_cuts_has_no_frequency():
    found = event_measures(motion_of(np.linspace(-1, 1, 200)[:, None] ** 3, 10.0, 0.3, 1), 10.0)
    assert np.isnan(found.frequency_hz[0])
    assert np.isnan(guideline_value(found.frequency_hz, "sensitive"))


@pytest.mark.parametrize(
    ("building", "expected"),
    [
        ("industrial", [20, 20, 30, 40, 45, 50, 50]),
        ("residential", [5, 5, 10, 15, 17.5, 20, 20]),
        ("sensitive", [3, 3, 5.5, 8, 9, 10, 10]),
    ],
)
def test_foundations_by_table_1_of_din_4150_3(building, expected):
    frequency = np.array([4, 10, 30, 50, 75, 100, 200.0])
    np.testing.assert_allclose(1e3 * guideline_value(frequency, building), expected)


def test_other_places_and_what_the_standard_leaves_open():
    assert guideline_value(np.array([7.0]), "residential", "top_floor") == pytest.approx(0.015)
    lasting = guideline_value(np.array([7.0]), "sensitive", "top_floor", "lasting")
    assert lasting == pytest.approx(0.0025)
    with pytest.raises(ValueError, match="gives no value for short vibration of a sensitive"):
        guideline_value(np.array([7.0]), "sensitive", "ceiling")
    with pytest.raises(ValueError, match="gives no value for lasting"):
        guideline_value(np.array([7.0]), "residential", "foundation", "lasting")
