"""Repeated samples: found where a sensor is polled, not where it is coarse."""

import numpy as np
import pytest

from slowtime.signals.repeated_samples import find_hold

RNG = np.random.default_rng(3)


def polled(sensor_hz: float, reader_hz: float, jitter: float = 0.0) -> tuple[np.ndarray, ...]:
    """Give the sensor's values, the rows that a reader gets, and when it reads them."""
    values = np.round(np.cumsum(RNG.standard_normal((2000, 2)), axis=0), 3)
    times = np.arange(int(1990 / sensor_hz * reader_hz)) / reader_hz
    times = times + jitter / reader_hz * RNG.uniform(-0.5, 0.5, len(times))
    return values, values[np.maximum((times * sensor_hz).astype(int), 0)], times


@pytest.mark.parametrize("reader_hz", [105.0, 150.0, 170.0, 200.0, 330.0, 1000.0])
def test_the_rate_of_a_polled_sensor_is_found_from_its_values(reader_hz):
    values, rows, _ = polled(100.0, reader_hz)
    hold = find_hold(rows)
    assert hold is not None
    assert hold.even
    assert reader_hz / hold.ratio == pytest.approx(100.0, rel=1e-3)
    np.testing.assert_array_equal(rows[hold.first], values[: len(hold.first)])


def test_new_values_at_random_are_not_even():
    values = RNG.standard_normal((2000, 2))
    rows = np.repeat(values, RNG.integers(1, 3, len(values)), axis=0)
    hold = find_hold(rows)
    assert hold is not None
    assert not hold.even


@pytest.mark.parametrize("step", [0.001, 0.01, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
def test_a_coarse_sensor_is_not_taken_for_a_polled_one(step, noise):
    t = np.arange(6000) / 100
    signal = np.sin(2 * np.pi * 1.3 * t) + noise * RNG.standard_normal(len(t))
    assert find_hold((np.round(signal / step) * step)[:, None]) is None


def test_rest_and_a_stop_are_no_repetition():
    t = np.arange(6000) / 100
    signal = RNG.standard_normal(len(t)) + np.sin(2 * np.pi * 0.2 * t)
    rest = np.where(t < 20, 0.0, signal)
    assert find_hold(rest[:, None]) is None
    assert find_hold(np.clip(signal, -1.0, 1.0)[:, None]) is None
