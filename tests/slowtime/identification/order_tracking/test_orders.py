"""Orders of a machine whose speed rises, against the amplitudes that were put in."""

import numpy as np
import pytest

from slowtime.identification.order_tracking import rotation_of, track_orders

RATE, SECONDS = 2000.0, 20.0
TIME = np.arange(round(RATE * SECONDS)) / RATE
TURNS = 10.0 * TIME + 0.75 * TIME**2
"""From 10 to 40 revolutions per second."""


def tacho(marks=1):
    return np.clip(4 * np.cos(2 * np.pi * marks * TURNS) - 2, 0, 1)


def run_up(noise=0.05, seed=1):
    rng = np.random.default_rng(seed)
    first = 2.0 * np.cos(2 * np.pi * TURNS + 0.5)
    second = 0.5 * np.cos(2 * np.pi * 3.6 * TURNS)
    return (first + second + noise * rng.standard_normal(len(TIME)))[:, None]


@pytest.mark.parametrize("marks", [1, 4])
def test_speed_and_angle_are_those_of_the_shaft(marks):
    rotation = rotation_of(tacho(marks), RATE, pulses_per_revolution=marks)
    inside = np.linspace(2.0, 18.0, 50)
    np.testing.assert_allclose(rotation.speed_hz(inside), 10 + 1.5 * inside, rtol=0.03)


def test_amplitudes_and_phases_of_orders_come_back_whatever_the_speed():
    found = track_orders(run_up(), RATE, rotation_of(tacho(), RATE), [1.0, 3.6])
    assert np.abs(found.amplitude[:, 0, 0]) == pytest.approx(2.0, abs=0.05)
    assert np.abs(found.amplitude[:, 1, 0]) == pytest.approx(0.5, abs=0.05)
    assert found.speed_hz[0] < 13 < 37 < found.speed_hz[-1]
    # The first pulse is an edge, at most 0.1 revolution from the top of the wave.
    phase = np.angle(found.amplitude[:, 0, 0])
    assert np.ptp(phase) < 0.1


def test_errors_are_those_seen_over_seeds():
    rotation = rotation_of(tacho(), RATE)
    runs = [track_orders(run_up(1.0, s), RATE, rotation, [1.0, 3.6]) for s in range(12)]
    amplitude = np.array([run.amplitude[:, :, 0] for run in runs])
    seen = np.sqrt(np.mean(np.abs(amplitude - amplitude.mean(axis=0)) ** 2, axis=0) * 12 / 11)
    told = np.sqrt(np.mean([run.sd[:, :, 0] ** 2 for run in runs], axis=0))
    np.testing.assert_allclose(np.median(told / seen, axis=0), 1.0, atol=0.25)


def test_a_missed_pulse_is_refused_with_its_time():
    broken = tacho()
    at = round(10.0 * RATE)
    broken[at - 40 : at + 40] = 0.0
    with pytest.raises(ValueError, match=r"factor .* a pulse was missed or added"):
        rotation_of(broken, RATE)


@pytest.mark.parametrize(
    ("orders", "revolutions", "says"),
    [
        ([1.0, 1.01], 16, "cannot be told apart in 16 revolutions"),
        ([60.0], 16, "beyond 0.45 of the sampling rate"),
        ([1.0], 10_000, "the shaft turned"),
        ([-1.0], 16, "positive ones"),
    ],
)
def test_what_cannot_be_tracked_is_said(orders, revolutions, says):
    with pytest.raises(ValueError, match=says):
        track_orders(
            run_up(), RATE, rotation_of(tacho(), RATE), orders, revolutions=revolutions
        )


def test_a_silent_tacho_is_refused():
    with pytest.raises(ValueError, match="at least 4 are needed"):
        rotation_of(np.zeros(1000), RATE)
