import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.signals.decimation import PASS, decimated, moved_down

RATE = 1000.0


def decay(pole, count=20_000, rate=RATE):
    return np.exp(np.multiply.outer(np.arange(count) / rate, pole)).real


@given(factor=st.integers(1, 40), share=st.floats(0.01, 0.99), phase=st.floats(0.0, 6.0))
def test_what_lies_in_the_band_that_is_kept_is_not_changed(factor, share, phase):
    hz = share * PASS * RATE / factor / 2
    instants = np.arange(20_000) / RATE
    slow = decimated(np.cos(2 * np.pi * hz * instants + phase)[:, None], RATE, factor)
    kept = slow.start_s + np.arange(len(slow.samples)) / slow.rate_hz
    assert slow.rate_hz == RATE / factor
    np.testing.assert_allclose(
        slow.samples[:, 0], np.cos(2 * np.pi * hz * kept + phase), atol=3e-4
    )


@given(factor=st.integers(2, 40), beyond=st.floats(0.0, 1.0))
def test_what_lies_beyond_half_the_lower_rate_is_gone(factor, beyond):
    half = RATE / factor / 2
    hz = half + beyond * (RATE / 2 - half)
    wave = np.cos(2 * np.pi * hz * np.arange(20_000) / RATE)[:, None]
    assert np.abs(decimated(wave, RATE, factor).samples).max() < 3e-4


@given(alpha=st.floats(0.1, 2.0), hz=st.floats(0.5, 15.0))
def test_a_decay_stays_a_decay_of_the_same_pole(alpha, hz):
    pole = -alpha + 2j * np.pi * hz
    slow = decimated(decay(pole)[:, None], RATE, 20)
    # Of a decay each sample follows from the two before it.
    step = np.exp(pole / slow.rate_hz)
    y = slow.samples[:, 0]
    predicted = 2 * step.real * y[1:-1] - abs(step) ** 2 * y[:-2]
    np.testing.assert_allclose(y[2:], predicted, atol=1e-9 * np.abs(y).max())


@given(centre=st.floats(60.0, 400.0), off=st.floats(-0.9, 0.9), alpha=st.floats(0.0, 1.0))
def test_a_band_moved_down_keeps_its_poles_less_the_shift(centre, off, alpha):
    width = 10.0
    pole = -alpha + 2j * np.pi * (centre + off * width)
    slow = moved_down(decay(pole), RATE, centre, width)
    step = np.exp((pole - 2j * np.pi * slow.shift_hz) / slow.rate_hz)
    y = slow.samples[:, 0]
    predicted = 2 * step.real * y[1:-1] - abs(step) ** 2 * y[:-2]
    np.testing.assert_allclose(y[2:], predicted, atol=1e-3 * np.abs(y).max())
    assert slow.rate_hz >= 6 * width


def test_a_band_moved_down_hears_nothing_of_what_is_far_from_it():
    far = sum(np.cos(2 * np.pi * hz * np.arange(20_000) / RATE) for hz in (12.0, 80.0, 140.0))
    assert np.abs(moved_down(far, RATE, 110.0, 10.0).samples).max() < 3e-4


def test_white_noise_stays_as_dense_as_it_was():
    noise = np.random.default_rng(3).standard_normal(200_000)
    slow = moved_down(noise, RATE, 200.0, 20.0)
    spectrum = np.abs(np.fft.rfft(slow.samples[:, 0])) ** 2 / len(slow.samples) / slow.rate_hz
    hz = np.fft.rfftfreq(len(slow.samples), 1 / slow.rate_hz) + slow.shift_hz
    inside = np.abs(hz - 200.0) < 20.0
    assert spectrum[inside].mean() * RATE == pytest.approx(1.0, rel=0.05)


def test_a_record_shorter_than_the_filter_is_refused_with_the_cure():
    with pytest.raises(ValueError, match=r"100 samples is shorter.*lower the rate less"):
        decimated(np.zeros((100, 1)), RATE, 20)
