import numpy as np
import pytest

from slowtime.history_diagnosis.data.mode_swaps import find_mode_swap


@pytest.fixture
def quiet(rng):
    return rng.standard_normal(400)


def test_readings_of_one_other_place_are_found_all_of_them_dense_or_not(quiet):
    other = np.array([3, 40, 41, 100, 210, 212, 213, 214, 216, 217, 218, 219, 300, 399])
    quiet[other] += 25.0
    found = find_mode_swap(quiet)
    assert found is not None
    np.testing.assert_array_equal(np.flatnonzero(found.which), other)
    assert abs(found.offset - 25.0) < 4.0 * found.sd + 0.5


def test_outliers_that_lie_anywhere_are_no_other_mode(quiet, rng):
    wild = rng.choice(400, 16, replace=False)
    quiet[wild] += rng.choice([-1.0, 1.0], 16) * rng.uniform(12.0, 60.0, 16)
    assert find_mode_swap(quiet) is None


def test_steps_and_teeth_are_no_other_mode(quiet):
    time = np.arange(400)
    assert find_mode_swap(quiet + 30.0 * (time > 170)) is None
    assert find_mode_swap(quiet + 0.6 * (time % 50)) is None
