"""Local maxima and prominences are those of another library, plateaus and all."""

import numpy as np
import scipy.signal as sps
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slowtime.signals.peaks import local_maxima, prominences

HILLS = hnp.arrays(float, st.integers(0, 60), elements=st.integers(-4, 4).map(float))


@given(HILLS)
def test_maxima_and_prominences_are_those_of_scipy(series):
    peaks = local_maxima(series)
    np.testing.assert_array_equal(peaks, sps.find_peaks(series)[0])
    np.testing.assert_array_equal(
        prominences(series, peaks), sps.peak_prominences(series, peaks)[0]
    )


def test_a_walk_of_many_steps_has_the_prominences_of_scipy():
    walk = np.random.default_rng(1).standard_normal(20_000).cumsum()
    peaks = local_maxima(walk)
    assert len(peaks) > 4000
    np.testing.assert_allclose(
        prominences(walk, peaks), sps.peak_prominences(walk, peaks)[0], rtol=0, atol=0
    )
