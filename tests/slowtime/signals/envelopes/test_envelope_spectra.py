"""Lines of an envelope: false alarms as stated, and real impacts named."""

import numpy as np
import pytest

from slowtime.signals.envelopes.envelope_spectra import (
    Band,
    envelope_spectrum,
    family,
    most_impulsive_band,
)
from slowtime.signals.envelopes.fault_frequencies import bearing_frequencies

RATE = 12_000.0
BAND = Band(2_000.0, 4_000.0)


def strikes(seed: int, per_second: float, noise: float) -> np.ndarray:
    """Impacts that slip by 0.5 %, and excite a resonance of 3 kHz."""
    rng = np.random.default_rng(seed)
    count = 60_000
    at = np.cumsum(RATE / per_second * (1 + 0.005 * rng.standard_normal(2_000)))
    impulses = np.zeros(count)
    impulses[at[at < count - 1].astype(int)] = 1.0
    time = np.arange(200) / RATE
    ringing = np.exp(-600 * time) * np.sin(2 * np.pi * 3_000 * time)
    return np.convolve(impulses, ringing)[:count] + noise * rng.standard_normal(count)


@pytest.mark.parametrize("multiples", [1, 2, 3])
def test_noise_is_called_a_line_no_oftener_than_stated(multiples: int):
    rng = np.random.default_rng(5)
    p = [
        family(
            envelope_spectrum(rng.standard_normal(30_000), RATE, BAND), 162.0, multiples, 0.02
        )
        for _ in range(300)
    ]
    below = np.mean([one.p_value < 0.05 for one in p])
    assert below < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 300)
    if multiples == 1:
        assert below > 0.02


def test_strikes_are_found_where_they_are_and_nowhere_else():
    held = 0
    for seed in range(10):
        samples = strikes(seed, 110.0, 0.3)
        spectrum = envelope_spectrum(
            samples, RATE, most_impulsive_band(samples, RATE, 4 * 200.0)
        )
        there = family(spectrum, 109.0, 2, 0.02)
        assert there.p_value < 1e-4
        held += abs(there.frequency_hz - 110.0) < 0.3
        # 165 Hz shares every second line with 110 Hz, and is not there.
        assert family(spectrum, 165.0, 2, 0.02).p_value > 1e-3
    assert held >= 9


def test_kurtosis_finds_the_resonance():
    band = most_impulsive_band(strikes(3, 110.0, 1.0), RATE, 800.0)
    assert band.low < 3_000 < band.high


def test_line_beyond_the_spectrum_is_refused_with_the_band_that_would_hold_it():
    spectrum = envelope_spectrum(np.random.default_rng(1).standard_normal(9_000), RATE, BAND)
    with pytest.raises(ValueError, match="wider than 2448 Hz"):
        family(spectrum, 600.0, 2, 0.02)


def test_bearing_of_the_textbook():
    # SKF 6205: 9 balls; factors that the bearing centre of Case Western Reserve tabulates.
    found = bearing_frequencies(1.0, 9, 0.3126, 1.537)
    assert found.inner_race == pytest.approx(5.4152, abs=1e-4)
    assert found.outer_race == pytest.approx(3.5848, abs=1e-4)
    assert found.rolling_element == pytest.approx(4.7135, abs=1e-4)
    assert found.cage == pytest.approx(0.39828, abs=1e-4)
