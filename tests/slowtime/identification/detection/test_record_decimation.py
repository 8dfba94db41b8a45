import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.detection.mode_isolation import MOST_BINS, isolate_mode
from slowtime.identification.detection.record_decimation import LONG, LongRecord
from slowtime.identification.detection.resonance_peaks import PeakCandidate
from slowtime.identification.free_decay.estimation import fit_segment
from slowtime.identification.single_mode.estimation import all_modes, first_mode


def ambient(hz, damping, seconds, rate, seed=1):
    rng = np.random.default_rng(seed)
    count = round(seconds * rate)
    unit = 4 * damping**2
    motion = ambient_acceleration(
        Oscillator.from_modal(hz, damping), count, rate, rng, force_psd=unit
    )
    return motion + np.sqrt(rate / 2e3) * rng.standard_normal(count)


def differences(one, other):
    return [
        (a.value - b.value) / b.sd
        for a, b in (
            (one.frequency_hz, other.frequency_hz),
            (one.damping_ratio, other.damping_ratio),
        )
    ]


def test_a_short_record_is_worked_as_it_is():
    columns = np.random.default_rng(1).standard_normal((LONG, 2))
    assert LongRecord(columns, 50e3).at_rate_for(8.0).samples is columns


@pytest.mark.parametrize("hz", [0.2, 8.0, 60.0])
def test_a_long_record_keeps_enough_samples_of_each_cycle_and_in_all(hz):
    rate = 20_000.0
    columns = np.random.default_rng(1).standard_normal((400_000, 1))
    slower = LongRecord(columns, rate).at_rate_for(hz)
    assert slower.rate_hz >= 32 * hz
    assert len(slower.samples) > 8000
    assert slower.rate_hz < 20_000


@pytest.mark.long
def test_a_mode_sampled_much_too_fast_is_that_of_the_same_motion_sampled_slowly():
    fast = ambient(8.0, 0.02, 60.0, 3200.0)
    slow = fast.reshape(-1, 16).mean(axis=1)
    ours, theirs = first_mode(fast, 3200.0), first_mode(slow, 200.0)
    assert ours is not None
    assert theirs is not None
    assert np.abs(differences(ours, theirs)).max() < 0.2
    assert ours.frequency_hz.sd == pytest.approx(theirs.frequency_hz.sd, rel=0.1)
    assert ours.method == theirs.method == "ambient"


def test_modes_far_apart_are_each_found_at_the_rate_that_they_need():
    rate = 3200.0
    samples = ambient(8.0, 0.01, 60.0, rate) + ambient(900.0, 0.01, 60.0, rate, seed=2)
    low, high = all_modes(samples, rate)
    for mode, hz in ((low, 8.0), (high, 900.0)):
        assert abs(mode.frequency_hz.value - hz) < 3 * mode.frequency_hz.sd
        assert abs(mode.damping_ratio.value - 0.01) < 3 * mode.damping_ratio.sd


def test_a_decay_of_thousands_of_cycles_is_read_off_its_nearest_bins():
    rate, seconds = 5000.0, 30.0
    pole = 2 * np.pi * 700.0 * (-5e-5 + 1j)
    instants = np.arange(round(rate * seconds)) / rate
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(instants))
    series = np.exp(pole * instants).real + noise
    candidate = PeakCandidate(700.0, 5.0, 2250.0, 40.0)
    part = isolate_mode(series, rate, candidate)
    assert len(part.series) < 7 * MOST_BINS
    mode = fit_segment(part, candidate).identified
    assert abs(mode.frequency_hz.value - abs(pole) / (2 * np.pi)) < 3 * mode.frequency_hz.sd
    assert abs(mode.damping_ratio.value - 5e-5) < 3 * mode.damping_ratio.sd
    # Cramér-Rao: nothing that tells of the decay is lost with the rest of the spectrum.
    alpha, snr = -pole.real, 1 / (2 * 0.05**2)
    weight = np.exp(-2 * alpha * instants)
    zeroth, first, second = (weight @ instants**k / rate for k in (0, 1, 2))
    bound = 1 / np.sqrt(snr * rate * (second - first**2 / zeroth)) / (2 * np.pi)
    assert mode.frequency_hz.sd == pytest.approx(bound, rel=0.15)


def test_a_blow_sampled_fast_is_read_from_its_first_cycle_on():
    rate, hz = 12_800.0, 8.0
    instants = np.arange(round(40 * rate)) / rate
    pole = 2 * np.pi * hz * (-0.05 + 1j * np.sqrt(1 - 0.05**2))
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(instants))
    mode = first_mode(np.exp(pole * instants).real + noise, rate)
    assert mode is not None
    assert mode.method == "free_decay"
    assert mode.span_s[0] < 0.25 / hz
    assert abs(mode.frequency_hz.value - hz) < 3 * mode.frequency_hz.sd
    assert abs(mode.damping_ratio.value - 0.05) < 3 * mode.damping_ratio.sd
