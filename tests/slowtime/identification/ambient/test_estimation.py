import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification import ambient_bound, ambient_law, identify_ambient, peak


def ambient(rng, *, f=10.0, z=0.01, seconds=60.0, rate=100.0, snr=1e3):
    count = round(seconds * rate)
    response = ambient_acceleration(
        Oscillator.from_modal(f, z), count, rate, rng, force_psd=4 * z * z
    )
    return response + rng.standard_normal(count) * np.sqrt(rate / 2 / snr)


def scores(runs, seed, identify=identify_ambient, **case):
    """Errors of f over f and of ln zeta, with the sd said, per run."""
    rng = np.random.default_rng(seed)
    rate, f, z = case.get("rate", 100.0), case.get("f", 10.0), case.get("z", 0.01)
    found = [identify(ambient(rng, **case), rate) for _ in range(runs)]
    frequency = [(m.frequency_hz.value / f - 1, m.frequency_hz.sd / f) for m in found]
    damping = [
        (np.log(m.damping_ratio.value / z), m.damping_ratio.sd / m.damping_ratio.value)
        for m in found
    ]
    return np.array(frequency), np.array(damping)


def bound(**case):
    f, z = case.get("f", 10.0), case.get("z", 0.01)
    cycles = f * case.get("seconds", 60.0)
    return ambient_bound(z, cycles, snr=case.get("snr", 1e3), reach=min(60.0, 0.9 / z))


@pytest.mark.long
@pytest.mark.parametrize("case", [{}, {"z": 0.04, "snr": 100.0}])
def test_errors_reach_the_bound_with_the_floor_fitted_and_are_what_is_said(case):
    for error, limit in zip(scores(120, 1, **case), bound(**case), strict=True):
        # Of 120 runs an RMSE scatters by 6.5 %; the benchmark asks 1.15 of 500.
        assert np.sqrt(np.mean(error[:, 0] ** 2)) < 1.22 * limit
        assert np.abs(np.mean(error[:, 0])) < 0.35 * np.std(error[:, 0])
        assert 0.89 < np.mean(np.abs(error[:, 0]) < 1.96 * error[:, 1]) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("snr", [100.0, 1e4])
@pytest.mark.parametrize(("f", "z", "rate"), [(10.0, 0.01, 100.0), (2.0, 0.03, 25.0)])
def test_coverage_and_rmse_hold_over_five_hundred_runs(f, z, rate, snr):
    case = {"f": f, "z": z, "rate": rate, "snr": snr, "seconds": 600 / f}
    for error, limit in zip(scores(500, 2, **case), bound(**case), strict=True):
        assert np.sqrt(np.mean(error[:, 0] ** 2)) < 1.15 * limit
        assert 0.92 < np.mean(np.abs(error[:, 0]) < 1.96 * error[:, 1]) < 0.975


@pytest.mark.long
def test_leakage_does_not_bias_damping_where_a_half_bandwidth_is_three_bins():
    _, damping = scores(150, 3, seconds=30.0, snr=1e4)
    assert abs(damping[:, 0].mean()) < 0.3 * damping[:, 0].std()


@pytest.mark.parametrize("gain", [1e-9, 1e6])
def test_the_unit_of_the_samples_does_not_matter(gain):
    record = ambient(np.random.default_rng(4))
    one, other = identify_ambient(record, 100.0), identify_ambient(gain * record, 100.0)
    assert other.frequency_hz.value == pytest.approx(one.frequency_hz.value, rel=1e-6)
    assert other.damping_ratio.sd == pytest.approx(one.damping_ratio.sd, rel=1e-3)
    assert other.amplitude == pytest.approx(gain * one.amplitude, rel=1e-3)


def test_the_amplitude_is_the_standard_deviation_of_the_mode():
    record = 3.0 * ambient(np.random.default_rng(5), seconds=600.0, snr=1e6)
    # Of a unit peak the half-bandwidth zeta f holds pi / 2 times its width.
    expected = 3.0 * np.sqrt(np.pi / 2 * 0.01 * 10.0)
    assert identify_ambient(record, 100.0).amplitude == pytest.approx(expected, rel=0.08)


@pytest.mark.long
def test_two_channels_are_weighted_by_their_noise():
    rng = np.random.default_rng(6)
    alone, both = [], []
    for _ in range(25):
        mode = ambient(rng, snr=1e9)
        good = mode + 0.3 * rng.standard_normal(len(mode))
        bad = -0.5 * mode + 20.0 * rng.standard_normal(len(mode))
        alone.append(identify_ambient(good, 100.0).frequency_hz.value)
        stacked = np.stack([bad, good], axis=1)
        both.append(identify_ambient(stacked, 100.0).frequency_hz.value)
    assert np.std(np.array(both) - np.array(alone)) < 0.3 * np.std(alone)


def test_a_band_selects_among_two_modes():
    rng = np.random.default_rng(7)
    record = ambient(rng, f=6.0) + 0.3 * ambient(rng, f=17.0)
    for band, truth in (((4.0, 9.0), 6.0), ((12.0, 25.0), 17.0)):
        found = identify_ambient(record, 100.0, band_hz=band).frequency_hz
        assert abs(found.value - truth) < 4 * found.sd


def test_displacement_has_its_own_shape():
    rng = np.random.default_rng(8)
    rate, f, z, count = 100.0, 5.0, 0.05, 60_000
    spectrum = np.fft.rfft(ambient(rng, f=f, z=z, rate=rate, seconds=count / rate, snr=1e9))
    omega = 2 * np.pi * np.fft.rfftfreq(count, 1 / rate)
    spectrum[1:] /= omega[1:] ** 2
    spectrum[:40] = 0.0
    displacement = np.fft.irfft(spectrum)
    found = identify_ambient(displacement, rate, band_hz=(1.0, 40.0), derivatives=0)
    assert abs(found.frequency_hz.value - f) < 3.5 * found.frequency_hz.sd
    assert abs(found.damping_ratio.value - z) < 3.5 * found.damping_ratio.sd


@pytest.mark.long
def test_noise_alone_is_flagged():
    rng = np.random.default_rng(9)
    flagged = [
        "below_threshold" in identify_ambient(rng.standard_normal(4000), 100.0).flags
        for _ in range(40)
    ]
    assert np.mean(flagged) > 0.9


@pytest.mark.long
def test_the_peak_agrees_with_the_likelihood_within_a_few_of_its_own_errors():
    frequency, damping = scores(60, 10, identify=peak, z=0.02, seconds=120.0)
    law = ambient_law(0.02, 1200.0)
    assert np.sqrt(np.mean(frequency[:, 0] ** 2)) < 3.0 * law[0]
    assert 0.5 < np.sqrt(np.mean((frequency[:, 0] / frequency[:, 1]) ** 2)) < 1.5
    assert np.sqrt(np.mean(damping[:, 0] ** 2)) < 4.0 * law[1]


def test_a_peak_narrower_than_the_record_resolves_says_so():
    wave = np.sin(2 * np.pi * 7.03 * np.arange(2000) / 100.0)
    noise = 1e-3 * np.random.default_rng(11).standard_normal(2000)
    found = peak(wave + noise, 100.0)
    assert "resolution_limited" in found.flags
    assert abs(found.frequency_hz.value - 7.03) < 3 * found.frequency_hz.sd
    assert found.frequency_hz.sd < 0.05
