import numpy as np
import pytest
import scipy.signal as sps

from slowtime.signals.interpolation import REACH, at_instants, polynomials

K = np.arange(600)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.25, 0.4, 0.43])
def test_a_tone_goes_on_between_its_samples(share):
    instants = np.random.default_rng(1).uniform(2 * REACH, 600 - 2 * REACH, 300)
    found = at_instants(np.sin(2 * np.pi * share * K + 0.4), instants)
    np.testing.assert_allclose(found, np.sin(2 * np.pi * share * instants + 0.4), atol=1e-5)


def test_at_its_samples_a_signal_is_its_samples():
    noise = np.random.default_rng(2).standard_normal((2, 50))
    np.testing.assert_allclose(at_instants(noise, np.arange(50.0)), noise, atol=1e-12)


@pytest.mark.parametrize("off", [1e-15, 1e-12, 1e-9])
def test_a_hair_beside_a_sample_no_digits_are_lost(off):
    noise = np.random.default_rng(2).standard_normal(200)
    for side in (-1, 1):
        found = at_instants(noise, np.array([100.0 + side * off * 100]))
        assert abs(found[0] - noise[100]) < 1e3 * off + 1e-13


def test_beyond_its_ends_a_signal_goes_on_turned_about_them():
    line = 2.0 + 0.5 * np.arange(50)
    found = at_instants(line, np.array([-3.5, 0.3, 48.6, 52.0]))
    np.testing.assert_allclose(found, [0.25, 2.15, 26.3, 28.0], atol=1e-3)


@pytest.mark.parametrize(("share", "error"), [(0.05, 3e-7), (0.1, 2e-6), (0.25, 4e-4)])
def test_polynomials_are_the_band_limited_signal(share, error):
    within = np.linspace(0, 1, 9)
    found = polynomials(np.sin(2 * np.pi * share * K), "band_limited")
    values = found[100:500] @ within ** np.arange(6)[:, None]
    truth = np.sin(2 * np.pi * share * (K[100:500, None] + within))
    np.testing.assert_allclose(values, truth, atol=error)


def test_polynomials_agree_with_another_upsampling():
    noise = sps.sosfiltfilt(
        sps.butter(6, 0.3, output="sos"), np.random.default_rng(3).standard_normal(600)
    )
    fine = sps.resample(noise, 8 * 600)
    values = polynomials(noise, "band_limited") @ (np.arange(8) / 8) ** np.arange(6)[:, None]
    inner = slice(8 * 100, 8 * 500)
    np.testing.assert_allclose(values.ravel()[inner], fine[inner], atol=2e-3)


def test_straight_lines_and_steps_are_what_they_say():
    series = np.array([1.0, 3.0, 2.0])
    within = np.array([0.0, 0.5])
    for hold, truth in (("first", [1, 2, 3, 2.5, 2, 2]), ("zero", [1, 1, 3, 3, 2, 2])):
        values = polynomials(series, hold) @ within ** np.arange(6)[:, None]
        np.testing.assert_allclose(values.ravel(), truth)
    with pytest.raises(ValueError, match=r"Allowed: band_limited, first, zero"):
        polynomials(series, "second")


@pytest.mark.parametrize("samples", [1, 2, 3, 40])
def test_short_records_have_polynomials_too(samples):
    found = polynomials(np.ones(samples), "band_limited")
    np.testing.assert_allclose(found[:, 0], 1.0)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)
