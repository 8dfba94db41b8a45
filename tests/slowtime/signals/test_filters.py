import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.signals.filters import ewma, fir, median, moving_average

NOISE = np.random.default_rng(11).standard_normal(200_000)
FILTERS = {
    "fir": lambda x: fir(x, np.array([0.5, 0.3, 0.2])),
    "moving_average": lambda x: moving_average(x, 4),
    "ewma": lambda x: ewma(x, 0.3),
    "median": lambda x: median(x, 5),
}


@pytest.mark.parametrize("name", FILTERS)
def test_a_constant_passes_unchanged(name):
    filtered = FILTERS[name](np.full(20, 3.5))
    np.testing.assert_allclose(filtered[np.isfinite(filtered)], 3.5, rtol=1e-14)


@pytest.mark.parametrize("name", FILTERS)
def test_inputs_are_left_as_they_were(name):
    x = np.arange(9.0)
    FILTERS[name](x)
    np.testing.assert_array_equal(x, np.arange(9.0))


@pytest.mark.parametrize("name", FILTERS)
@given(missing=st.sets(st.integers(0, 29), max_size=20))
def test_missing_readings_are_passed_over(name, missing):
    x = np.sin(np.arange(30.0))
    gappy = x.copy()
    gappy[sorted(missing)] = np.nan
    filtered = FILTERS[name](gappy)
    present = np.isfinite(gappy)
    np.testing.assert_array_equal(filtered[present], FILTERS[name](x[present]))
    assert np.isnan(filtered[~present]).all()


@pytest.mark.parametrize("window", [2, 5, 16])
def test_a_moving_average_divides_the_variance_by_its_window(window):
    assert np.nanvar(moving_average(NOISE, window)) == pytest.approx(1 / window, rel=0.03)


def test_a_moving_average_has_the_gain_of_a_dirichlet_kernel():
    n, w = 7, 0.4
    wave = np.exp(1j * w * np.arange(400))
    out = moving_average(wave.real, n) + 1j * moving_average(wave.imag, n)
    expected = abs(np.sin(n * w / 2) / (n * np.sin(w / 2)))
    assert abs(out[-1]) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("a", [0.1, 0.2, 0.6])
def test_an_ewma_leaves_a_over_two_minus_a_of_the_variance(a):
    assert np.var(ewma(NOISE, a)[200:]) == pytest.approx(a / (2 - a), rel=0.03)


@pytest.mark.parametrize("a", [0.1, 0.5])
def test_an_ewma_lags_a_ramp_by_its_delay(a):
    ramp = np.arange(400.0)
    assert ramp[-1] - ewma(ramp, a)[-1] == pytest.approx((1 - a) / a, rel=1e-9)


def test_an_ewma_halves_the_power_where_the_formula_says():
    a = 0.2
    w = np.arccos(1 - a**2 / (2 * (1 - a)))
    wave = np.exp(1j * w * np.arange(2000))
    out = ewma(wave.real, a) + 1j * ewma(wave.imag, a)
    assert abs(out[-1]) ** 2 == pytest.approx(0.5, rel=1e-6)


@given(where=st.sets(st.integers(0, 4), max_size=2), size=st.floats(-1e9, 1e9))
def test_a_median_of_five_kills_two_outliers_in_a_window(where, size):
    x = np.full(5, 1.0)
    x[sorted(where)] = size
    assert median(x, 5)[-1] == 1.0


def test_a_median_costs_half_as_much_again_as_a_mean():
    window = 51
    assert np.nanvar(median(NOISE[:60_000], window)[window:]) == pytest.approx(
        np.pi / 2 / window, rel=0.06
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: median(NOISE[:9], 4), "no middle reading"),
        (lambda: moving_average(NOISE[:9], 0), "not a valid number of readings"),
        (lambda: ewma(NOISE[:9], 0.0), r"outside \(0, 1\]"),
        (lambda: fir(NOISE[:9], np.zeros(0)), "no weights"),
    ],
)
def test_what_cannot_filter_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
