import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.dynamics.evolution_functions import mass_change, stiffness_change

PRINTED = [
    (0, 0.0, 0.0),
    (1, -0.0004094396940982756, 0.01193662073189215),
    (3, -0.001284866097809394, 0.03580986219567645),
]


@pytest.mark.parametrize(("time", "dk", "dm"), PRINTED)
def test_known_values_come_out(time, dk, dm):
    assert stiffness_change(np.array([float(time)]))[0] == pytest.approx(dk, abs=2e-16)
    assert mass_change(np.array([float(time)]))[0] == pytest.approx(dm, abs=2e-16)


@pytest.mark.data
def test_the_reference_series_comes_out_to_its_printed_precision(tables):
    with (tables / "T1_twin_series.csv").open() as file:
        rows = list(csv.DictReader(file))
    time, dk, dm = (
        np.array([float(row[name]) for row in rows])
        for name in ("ts_over_T0", "Delta_k", "Delta_m")
    )
    np.testing.assert_allclose(stiffness_change(time), dk, atol=3e-16)
    np.testing.assert_allclose(mass_change(time), dm, atol=1e-13)


@given(time=st.floats(0, 5e4))
def test_stiffness_is_only_lost_and_never_all_of_it(time):
    assert -1 < stiffness_change(np.array([time]))[0] <= 0


@given(time=st.floats(0, 1e4))
def test_mass_comes_back_after_each_tooth(time):
    tooth = 2 * np.pi / 0.15
    now, later = mass_change(np.array([time, time + tooth]))
    assert abs(now) <= 0.25
    assert abs(later - now) < 1e-9 or abs(later - now) == pytest.approx(0.5, abs=1e-9)
