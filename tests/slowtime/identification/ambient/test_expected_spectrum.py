import numpy as np
import pytest

from slowtime.identification.ambient.expected_spectrum import expected_resonance


def density(frequency, natural, damping, derivatives):
    square = (frequency / natural) ** 2
    return 4 * damping**2 * square**derivatives / ((1 - square) ** 2 + 4 * damping**2 * square)


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_a_very_long_record_shows_the_density_itself(derivatives):
    frequency = np.arange(5, 400) / 20
    found = expected_resonance(
        frequency,
        natural_hz=8.0,
        damping_ratio=0.02,
        rate_hz=50.0,
        count=10_000_000,
        derivatives=derivatives,
    )
    np.testing.assert_allclose(
        found, density(frequency, 8.0, 0.02, derivatives), rtol=2e-3, atol=1e-5
    )


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_a_short_record_shows_the_density_convolved_with_fejers_kernel(derivatives):
    count, rate, natural, damping = 1000, 50.0, 8.0, 0.005
    fine = 64
    grid = np.arange(-count * fine // 2, count * fine // 2) * rate / (count * fine)
    truth = density(np.abs(grid), natural, damping, derivatives)
    # By the convolution theorem: autocovariance, triangle, back.
    covariance = np.fft.fft(np.fft.ifftshift(truth))
    lag = np.minimum(np.arange(len(grid)), len(grid) - np.arange(len(grid)))
    seen = np.fft.ifft(covariance * np.maximum(1 - lag / count, 0.0)).real[: len(grid) // 2]
    frequency = np.arange(120, 200) * rate / count
    found = expected_resonance(
        frequency,
        natural_hz=natural,
        damping_ratio=damping,
        rate_hz=rate,
        count=count,
        derivatives=derivatives,
    )
    expected = seen[np.arange(120, 200) * fine]
    np.testing.assert_allclose(found, expected, rtol=1e-2, atol=2e-5)
    bare = density(frequency, natural, damping, derivatives)
    assert np.abs(bare / expected - 1).max() > 0.1
