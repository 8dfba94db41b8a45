import numpy as np
import pytest

from slowtime.identification import free_decay_bound, identify_free_decay


def decay(rng, *, f=10.0, z=0.01, seconds=8.0, rate=400.0, snr=100.0, offset=0.3):
    omega, times = 2 * np.pi * f, np.arange(round(seconds * rate)) / rate
    wave = np.cos(omega * np.sqrt(1 - z * z) * times + rng.uniform(0, 6.28))
    noise = rng.standard_normal(len(times)) / np.sqrt(2 * snr)
    return np.exp(-z * omega * times) * wave + noise + offset


def errors(runs, seed, **case):
    rng = np.random.default_rng(seed)
    found = [
        identify_free_decay(decay(rng, **case), case.get("rate", 400.0)) for _ in range(runs)
    ]
    f, z = case.get("f", 10.0), case.get("z", 0.01)
    frequency = np.array([(m.frequency_hz.value - f, m.frequency_hz.sd) for m in found])
    damping = np.array([(m.damping_ratio.value - z, m.damping_ratio.sd) for m in found])
    bound = free_decay_bound(
        decay_rate=z * 2 * np.pi * f,
        duration_s=case.get("seconds", 8.0),
        rate_hz=case.get("rate", 400.0),
        snr=case.get("snr", 100.0),
    )
    return frequency, damping, bound / (2 * np.pi), bound / (2 * np.pi * f)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param({"snr": 10.0}, marks=pytest.mark.long),
        {"f": 3.0, "z": 0.04, "rate": 80.0},
    ],
)
def test_errors_reach_the_cramer_rao_bound_and_are_what_is_said(case):
    frequency, damping, bound_f, bound_z = errors(120, 1, **case)
    for error, bound in ((frequency, bound_f), (damping, bound_z)):
        # Of 120 runs an RMSE scatters by 6.5 %; the benchmark asks 1.10 of 500.
        assert np.sqrt(np.mean(error[:, 0] ** 2)) < 1.18 * bound
        assert np.mean(error[:, 1]) == pytest.approx(bound, rel=0.06)
        assert 0.89 < np.mean(np.abs(error[:, 0]) < 1.96 * error[:, 1]) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("snr", [10.0, 100.0, 1e4])
@pytest.mark.parametrize("z", [0.002, 0.01, 0.05])
def test_coverage_and_rmse_hold_over_five_hundred_runs(z, snr):
    frequency, damping, bound_f, bound_z = errors(500, 2, z=z, snr=snr, seconds=0.05 / z * 1.2)
    for error, bound in ((frequency, bound_f), (damping, bound_z)):
        assert np.sqrt(np.mean(error[:, 0] ** 2)) < 1.10 * bound
        assert 0.92 < np.mean(np.abs(error[:, 0]) < 1.96 * error[:, 1]) < 0.975


def test_a_clean_decay_is_recovered_as_the_undamped_natural_frequency():
    times = np.arange(4000) / 500.0
    omega, z = 2 * np.pi * 12.0, 0.2
    clean = np.exp(-z * omega * times) * np.sin(omega * np.sqrt(1 - z * z) * times)
    found = identify_free_decay(clean, 500.0)
    assert found.frequency_hz.value == pytest.approx(12.0, abs=1e-6)
    assert found.damping_ratio.value == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("gain", [1e-9, 1.0, 1e6])
def test_the_unit_of_the_samples_does_not_matter(gain):
    record = decay(np.random.default_rng(3))
    one, other = identify_free_decay(record, 400.0), identify_free_decay(gain * record, 400.0)
    assert other.frequency_hz.value == pytest.approx(one.frequency_hz.value, rel=1e-7)
    assert other.frequency_hz.sd == pytest.approx(one.frequency_hz.sd, rel=1e-3)
    assert other.amplitude == pytest.approx(gain * one.amplitude, rel=1e-4)


def two_modes(rng):
    return decay(rng, f=8.0, snr=1e4) + 3.0 * decay(rng, f=35.0, z=0.005, snr=1e4)


def test_of_two_modes_the_lowest_is_taken_and_the_other_in_its_band():
    scores = []
    rng = np.random.default_rng(4)
    for _ in range(20):
        record = two_modes(rng)
        low = identify_free_decay(record, 400.0).frequency_hz
        high = identify_free_decay(record, 400.0, band_hz=(25.0, 50.0)).frequency_hz
        scores.append([(low.value - 8.0) / low.sd, (high.value - 35.0) / high.sd])
        assert low.sd < 2e-3
    assert np.all(np.sqrt(np.mean(np.square(scores), axis=0)) < 1.5)


def test_two_close_modes_are_fitted_together_and_do_not_bias_each_other():
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(30):
        record = decay(rng, f=26.2, seconds=2.0, snr=1e4)
        record = record + 0.25 * decay(rng, f=24.3, seconds=2.0, snr=1e4)
        found = identify_free_decay(record, 400.0).frequency_hz
        scores.append((found.value - 26.2) / found.sd)
    assert np.sqrt(np.mean(np.square(scores))) < 1.6


def test_below_the_threshold_it_says_so():
    rng = np.random.default_rng(6)
    flagged = [
        "below_threshold" in identify_free_decay(rng.standard_normal(3000), 400.0).flags
        for _ in range(40)
    ]
    assert np.mean(flagged) > 0.9


def test_coloured_noise_widens_the_error_to_its_density_at_the_mode():
    from scipy.signal import lfilter

    rng = np.random.default_rng(7)
    scores = []
    for _ in range(60):
        noise = lfilter([1.0], [1.0, -0.97], rng.standard_normal(3200)) * 0.05
        record = decay(rng, f=4.0, z=0.02, snr=1e9) + noise
        found = identify_free_decay(record, 400.0, band_hz=(2.0, 8.0)).frequency_hz
        scores.append((found.value - 4.0) / found.sd)
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.35


def test_the_record_is_not_changed_and_the_answer_does_not_vary():
    record = two_modes(np.random.default_rng(8))
    before = record.copy()
    assert identify_free_decay(record, 400.0) == identify_free_decay(record, 400.0)
    np.testing.assert_array_equal(record, before)
