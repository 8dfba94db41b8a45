"""What a diagnosis tells of the damping of free decays, before any model is fitted."""

import numpy as np

from slowtime.discrepancy.free_decay.damping import describe_damping
from slowtime.discrepancy.records import Trial

RATE = 50.0
T = np.arange(1000) / RATE


def record(size, use=None):
    """Return a record of two sensors, with noise."""
    wave = size * np.cos(2 * np.pi * T)
    outputs = np.outer(wave, [1.0, 0.5])
    outputs += 1e-3 * np.random.default_rng(0).standard_normal(outputs.shape)
    return Trial(inputs=np.zeros((len(T), 0)), outputs=outputs, rate_hz=RATE, use=use)


def test_dependence_on_amplitude_is_told_record_by_record():
    steady = np.exp(-0.01 * 2 * np.pi * T)
    friction = np.maximum(1.0 - 0.045 * T, 0.0)
    said = list(describe_damping([record(steady), record(friction)]))
    assert said[0].startswith("Free decay 1, mode at 1 Hz: the damping ratio is 0.99")
    assert said[1].startswith("Free decay 2")
    assert "falls with amplitude" in said[1]
    assert "dry friction" in said[1]


def test_a_record_without_a_decay_or_a_complete_sensor_is_passed_over():
    use = np.ones((len(T), 2), dtype=bool)
    use[7] = False
    assert (
        list(describe_damping([record(np.zeros(len(T))), record(np.ones(len(T)), use)])) == []
    )
