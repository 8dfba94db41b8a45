"""Tapers, designs and convolutions are those of another library."""

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.signals.finite_filters import convolved, kaiser_order, taper, windowed_sinc


@pytest.mark.parametrize("name", ["boxcar", "hann"])
@pytest.mark.parametrize("count", [8, 9, 1000])
def test_tapers_are_those_of_scipy(name, count):
    np.testing.assert_allclose(taper(name, count), sps.get_window(name, count), atol=1e-15)


def test_a_taper_that_is_none_is_refused_with_those_that_are():
    with pytest.raises(
        ValueError, match=r"'tukey' is not a valid taper. Allowed: boxcar, hann."
    ):
        taper("tukey", 8)


@pytest.mark.parametrize("kind", ["lowpass", "highpass"])
def test_designs_are_those_of_scipy(kind):
    length, beta = kaiser_order(70.0, 0.05)
    assert (length, beta) == pytest.approx(sps.kaiserord(70.0, 0.05))
    length |= 1
    theirs = sps.firwin(length, 0.2, window=("kaiser", beta), pass_zero=kind)
    np.testing.assert_allclose(windowed_sinc(length, 0.2, beta, kind), theirs, atol=1e-14)


def test_an_attenuation_beyond_the_rule_is_refused():
    with pytest.raises(ValueError, match="not above 50 dB"):
        kaiser_order(40.0, 0.1)


@pytest.mark.parametrize("count", [7, 100, 4097, 50_000])
@pytest.mark.parametrize("taps", [1, 6, 7])
def test_a_convolution_by_blocks_is_the_plain_sum(count, taps):
    rng = np.random.default_rng(count)
    series, weights = rng.standard_normal(count), rng.standard_normal(taps)
    plain = np.convolve(series, weights, "valid")
    np.testing.assert_allclose(convolved(series, weights), plain, atol=1e-12)


def test_many_taps_are_convolved_as_few_are():
    rng = np.random.default_rng(2)
    series, weights = rng.standard_normal(20_000), rng.standard_normal(5001)
    plain = np.convolve(series, weights, "valid")
    np.testing.assert_allclose(convolved(series, weights), plain, atol=1e-9)
