import numpy as np
import pytest

from slowtime.identification import (
    first_mode,
    identify_ambient,
    identify_free_decay,
    identify_windows,
    peak,
)
from slowtime.identification.checks import share_below

RATE = 100.0
NOISE = np.random.default_rng(0).standard_normal(1000)
ENTRIES = [first_mode, identify_ambient, identify_free_decay, peak]


def with_one(value):
    spoilt = NOISE.copy()
    spoilt[7] = value
    return spoilt


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize(
    ("samples", "says"),
    [
        (with_one(np.nan), r"1 of 1000 samples are NaN.*row 7.*cut the record at the gap"),
        (with_one(np.inf), r"NaN or infinite"),
        (np.full(1000, 2.5), r"1 channels is constant.*Check the sensor"),
        (NOISE[:31], r"31 samples were given, at least 32.*longer record"),
    ],
)
def test_hopeless_samples_are_refused_with_the_cure(entry, samples, says):
    with pytest.raises(ValueError, match=says):
        entry(samples, RATE)


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize(
    ("band", "says"),
    [
        ((5.0, 60.0), r"not a band between 0 and 50 Hz.*sample faster"),
        ((0.0, 10.0), r"Give 0 < low < high"),
        ((9.0, 4.0), r"Give 0 < low < high"),
        ((4.0, np.nan), r"Give 0 < low < high"),
        ((4.0, 4.2), r"narrower than 4 frequency bins.*Widen it"),
    ],
)
def test_a_band_that_cannot_be_searched_is_refused_with_one_that_can(entry, band, says):
    with pytest.raises(ValueError, match=says):
        entry(NOISE, RATE, band_hz=band)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(rate):
    with pytest.raises(ValueError, match="Give samples per second"):
        first_mode(NOISE, rate)


# The shape checker of the tests stands before these two; outside of tests nothing does.
@pytest.mark.parametrize(
    ("samples", "says"),
    [
        (NOISE + 1j, r"complex128 were given.*the measured signal itself"),
        (NOISE.reshape(10, 10, 10), r"shape \(10, 10, 10\).*instants in rows"),
    ],
)
def test_shapes_and_types_that_are_no_record_are_refused(samples, says):
    from slowtime.identification import checks

    with pytest.raises(ValueError, match=says):
        getattr(checks.series, "__wrapped__", checks.series)(samples, RATE)


def test_a_dead_channel_beside_a_live_one_is_left_out():
    from slowtime.identification import checks

    live = checks.series(np.stack([np.ones(1000), NOISE], axis=1), RATE)
    np.testing.assert_array_equal(live[:, 0], NOISE)


@pytest.mark.parametrize(
    ("window", "hop", "says"),
    [
        (0.1, None, r"window_s=0.1 does not fit.*0.32 s.*10 s"),
        (11.0, None, r"window_s=11 does not fit"),
        (np.nan, None, r"does not fit"),
        (1.0, 0.0, r"less than one sample. Give at least 0.01 s"),
    ],
)
def test_windows_that_do_not_fit_are_refused_with_what_does(window, hop, says):
    with pytest.raises(ValueError, match=says):
        identify_windows(NOISE, RATE, window_s=window, hop_s=hop)


def test_the_share_below_a_frequency_is_that_of_the_sines_there():
    t = np.arange(2000) / RATE
    both = 3.0 * np.sin(2 * np.pi * 0.5 * t) + 4.0 * np.sin(2 * np.pi * 8.0 * t) + 5.0
    assert share_below(both[:, None], RATE, 2.0) == pytest.approx(9 / 25, abs=0.01)
    assert share_below(np.ones((100, 1)), RATE, 2.0) == 0.0
