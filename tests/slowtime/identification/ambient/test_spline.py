"""The spline is that of another library."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from slowtime.identification.ambient.spline import cubic_spline


@pytest.mark.parametrize("count", [4, 5, 30])
def test_a_spline_is_that_of_scipy(count):
    rng = np.random.default_rng(count)
    places = np.cumsum(rng.uniform(0.1, 1.0, count))
    values = rng.standard_normal(count)
    at = np.linspace(places[0], places[-1], 500)
    np.testing.assert_allclose(
        cubic_spline(places, values, at), CubicSpline(places, values)(at), atol=1e-10
    )
