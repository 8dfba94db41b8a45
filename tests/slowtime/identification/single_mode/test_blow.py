import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import simulate
from slowtime.identification.single_mode.estimation import first_mode


def struck(rng: np.random.Generator, *modes: tuple[float, float], seconds: float = 20.0):
    """One blow at the first sample, then the decay of every mode, in a little noise."""
    rate = 50.0
    rest = np.zeros(round(seconds * rate))
    record = 0.02 * rng.standard_normal(len(rest))
    for frequency, damping in modes:
        speed = 1.0 / (2 * np.pi * frequency)
        osc = Oscillator.from_modal(frequency, damping)
        record = record + simulate(osc, rest, rate, initial=(0.0, speed))[2]
    return record, rate


@pytest.mark.parametrize("method", ["auto", "free_decay"])
def test_a_decay_followed_by_silence_is_read_off_its_loud_beginning(method):
    rng = np.random.default_rng(8)
    scores = []
    for _ in range(60):
        found = first_mode(*struck(rng, (6.0, 0.02)), method=method)
        assert found is not None
        assert found.method == "free_decay"
        scores.append(
            [
                (found.frequency_hz.value - 6.0) / found.frequency_hz.sd,
                (found.damping_ratio.value - 0.02) / found.damping_ratio.sd,
            ]
        )
    spread = np.std(scores, axis=0)
    assert np.all((spread > 0.75) & (spread < 1.25))
    assert np.all(np.abs(np.mean(scores, axis=0)) < 0.45)


def test_of_two_modes_struck_at_once_the_lower_is_the_first():
    rng = np.random.default_rng(9)
    found = first_mode(*struck(rng, (4.0, 0.02), (11.0, 0.01)))
    assert found is not None
    assert found.frequency_hz.value == pytest.approx(4.0, abs=5 * found.frequency_hz.sd)
    assert found.frequency_hz.sd < 0.01


def test_silence_has_no_mode():
    rng = np.random.default_rng(10)
    claimed = sum(first_mode(rng.standard_normal(1000), 50.0) is not None for _ in range(60))
    assert claimed <= 2
