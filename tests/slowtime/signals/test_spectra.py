import numpy as np
import pytest

from slowtime.signals.spectra import (
    detrended,
    noise_floor,
    periodogram,
    smoothed,
    transform,
    welch,
)


@pytest.mark.parametrize("count", [1000, 1001])
@pytest.mark.parametrize("taper", ["boxcar", "hann"])
def test_density_times_spacing_adds_up_to_the_tapered_power(count, taper):
    samples = np.random.default_rng(1).standard_normal((count, 2)) @ np.diag([1.0, 3.0])
    spectrum = periodogram(samples, 50.0, taper=taper)
    window = {"boxcar": np.ones(count), "hann": np.hanning(count + 1)[:-1]}[taper]
    power = np.sum((samples * window[:, None]) ** 2, axis=0) / np.sum(window**2)
    assert spectrum.density.sum(axis=0) * spectrum.spacing_hz == pytest.approx(power)


def test_white_noise_has_the_density_of_its_variance_over_the_half_rate():
    samples = np.random.default_rng(2).standard_normal((200_000, 1))
    for spectrum in (periodogram(samples, 40.0), welch(samples, 40.0, segment_s=5.0)):
        inner = spectrum.density[2:-2, 0]
        assert inner.mean() == pytest.approx(1.0 / 20.0, rel=0.02)


def test_coefficients_are_linear_and_their_squares_are_densities():
    samples = np.random.default_rng(3).standard_normal((64, 2))
    _, one = transform(samples, 8.0)
    _, both = transform(samples @ np.array([[1.0], [2.0]]), 8.0)
    np.testing.assert_allclose(both[:, 0], one[:, 0] + 2 * one[:, 1])
    np.testing.assert_allclose(np.abs(one) ** 2, periodogram(samples, 8.0).density)


def test_a_line_is_taken_out_and_nothing_else():
    times = np.arange(400.0)
    wave = np.sin(2 * np.pi * times * 25 / 400)
    wave -= np.polyval(np.polyfit(times, wave, 1), times)
    left = detrended((wave + 5.0 - 0.3 * times)[:, None])
    np.testing.assert_allclose(left[:, 0], wave, atol=1e-10)


def test_smoothing_averages_in_proportion_to_frequency_and_keeps_a_flat_spectrum():
    flat = np.full((500, 1), 7.0)
    level, number = smoothed(flat, 0.02)
    np.testing.assert_allclose(level, 7.0)
    assert number[10] == 1
    assert number[200] == 9


def test_the_floor_is_the_mean_density_of_noise_and_passes_under_a_peak():
    rng = np.random.default_rng(4)
    density = rng.exponential(size=(20_000, 1)) * 3.0
    density[5000:5040] *= 1e4
    floor = noise_floor(density)[:, 0]
    assert np.median(floor[200:]) == pytest.approx(3.0, rel=0.05)
    assert floor[5020] < 6.0


def test_the_floor_follows_coloured_noise():
    index = np.arange(20_000)
    truth = 1.0 / (1.0 + (index / 300.0) ** 2)
    density = np.random.default_rng(5).exponential(size=20_000) * truth
    ratio = noise_floor(density[:, None])[50:10_000, 0] / truth[50:10_000]
    # On a slope of 40 dB a decade a low percentile lies below the local mean.
    assert 0.7 < np.median(ratio) < 1.1
    assert np.all((ratio > 0.4) & (ratio < 2.0))


@pytest.mark.parametrize("segment", [0.01, 11.0])
def test_a_segment_that_does_not_fit_is_refused_with_what_does(segment):
    with pytest.raises(ValueError, match=r"segment_s=.*Give a segment from 0\.08 s to 10 s"):
        welch(np.ones((1000, 1)), 100.0, segment_s=segment)
