import numpy as np
import pytest

from slowtime.identification import first_mode
from slowtime.identification.single_mode.machine_lines import modes_and_machine_lines
from tests.slowtime.identification.oscillators import record

RATE = 100.0
MODE = {"f": 6.3, "z": 0.02, "rate": RATE, "seconds": 100.0, "noise": 0.05}


def with_machine(rng, speed, orders, size):
    """One channel of a mode, and a machine that turns beside it."""
    made = record(rng, **MODE)
    seconds = np.arange(len(made))[:, None] / RATE
    turn = sum(np.sin(2 * np.pi * k * speed * seconds + k) for k in orders)
    return made + size * made.std() * turn


def test_one_channel_tells_multiples_of_a_machine_from_its_mode():
    made = with_machine(np.random.default_rng(1), 4.7, (1, 3, 5), 0.5)
    told = modes_and_machine_lines(made, RATE)
    assert [m.frequency_hz.value for m in told.modes] == [pytest.approx(6.3, abs=0.1)]
    mode = told.modes[0]
    assert abs(mode.damping_ratio.value - 0.02) < 3.5 * mode.damping_ratio.sd
    lines = [line.frequency_hz.value for line in told.lines]
    assert lines == pytest.approx([4.7, 14.1, 23.5], abs=0.01)
    assert [f.base_hz.value for f in told.families] == [pytest.approx(4.7, abs=1e-3)]


def test_a_line_below_the_mode_is_not_the_first_mode():
    found = first_mode(with_machine(np.random.default_rng(2), 3.3, (1,), 1.0), RATE)
    assert found is not None
    assert found.frequency_hz.value == pytest.approx(6.3, abs=0.1)


def test_a_free_decay_is_never_taken_for_a_machine():
    times = np.arange(2000) / RATE
    decay = np.exp(-0.004 * 2 * np.pi * 5.0 * times) * np.sin(2 * np.pi * 5.0 * times)
    decay = decay + 1e-3 * np.random.default_rng(3).standard_normal(2000)
    told = modes_and_machine_lines(decay, RATE)
    assert told.lines == ()
    assert told.modes[0].damping_ratio.value == pytest.approx(0.004, rel=0.05)
