"""What stands on or beside a machine's multiples is doubted; what is near by chance is not."""

import numpy as np
import pytest

from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.beside_lines import MachineLines
from slowtime.identification.harmonics.families import group_into_families
from slowtime.identification.methods import by_method

LINES = tuple(Measured(9.7 * order, 1e-4) for order in (2, 3, 5, 6, 8))
DURATION_S = 60.0
LIGHT = Measured(0.0005, 0.0004)
HEAVY = Measured(0.01, 0.001)


def machines(lines=LINES):
    families = group_into_families(lines, resolution_hz=1 / DURATION_S)
    return MachineLines(lines, families, DURATION_S)


def test_a_multiple_that_was_not_detected_is_no_mode():
    assert machines().judge(Measured(9.7 * 4 + 0.02, 0.02), LIGHT) == "harmonic"


def test_a_damped_mode_on_a_multiple_is_doubtful():
    assert machines().judge(Measured(9.7 * 4 + 0.02, 0.02), HEAVY) == "doubtful"


def test_a_line_in_the_half_power_band_makes_a_mode_doubtful():
    alone = MachineLines((Measured(20.0, 1e-3),), (), DURATION_S)
    assert alone.judge(Measured(20.15, 0.02), HEAVY) == "doubtful"
    assert alone.judge(Measured(20.15 + 0.2, 0.02), HEAVY) == "mode"


@pytest.mark.parametrize("base_hz", [0.5, 2.0, 9.7])
def test_few_modes_that_know_nothing_of_a_machine_are_called_its_multiples(base_hz):
    lines = tuple(Measured(base_hz * order, 1e-5) for order in (1, 2, 3, 4, 5))
    families = group_into_families(lines, resolution_hz=1 / DURATION_S)
    assert families
    speeds = MachineLines((), families, DURATION_S)
    anywhere = np.random.default_rng(5).uniform(6 * base_hz, 40 * base_hz, 2000)
    said = [speeds.judge(Measured(float(f), 0.5), LIGHT) for f in anywhere]
    assert np.mean([verdict != "mode" for verdict in said]) < 0.07


def test_no_damping_is_no_evidence_of_a_line():
    unknown = Measured(np.nan, np.nan)
    assert machines().judge(Measured(9.7 * 4, 0.02), unknown) == "doubtful"


@pytest.mark.parametrize("method", ["modes", "bayes", "efdd"])
def test_every_method_doubts_a_mode_that_a_strong_line_crosses(method):
    rng = np.random.default_rng(3)
    rate, count = 100.0, 60_000
    pole = 2 * np.pi * 12.0 * (-0.02 + 1j * np.sqrt(1 - 0.02**2)) / rate
    frequency = np.fft.rfftfreq(count, 1 / rate)
    turn = np.exp(2j * np.pi * frequency / rate)
    answer = 1.0 / ((turn - np.exp(pole)) * (turn - np.exp(pole.conjugate())))
    mode = np.fft.irfft(np.fft.rfft(rng.standard_normal(count)) * answer, count)
    seconds = np.arange(count) / rate
    line = mode.std() * np.sin(2 * np.pi * 12.1 * seconds)
    noise = 0.05 * mode.std() * rng.standard_normal(count)
    with_line = by_method(mode + line + noise, rate, method=method).structural
    without = by_method(mode + noise, rate, method=method).structural
    assert [m.flags for m in with_line if abs(m.frequency_hz.value - 12.0) < 0.2] == [
        ("beside_a_line",)
    ]
    assert all("beside_a_line" not in m.flags for m in without)
