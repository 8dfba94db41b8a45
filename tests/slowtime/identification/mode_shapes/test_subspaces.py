import numpy as np
import pytest

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.mode_shapes.subspaces import auto_mac, coordinate_mac, subspace_mac


def shapes(seed, channels=6, modes=3):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((channels, modes)) + 1j * rng.standard_normal((channels, modes))


def test_auto_mac_is_symmetric_with_unit_diagonal():
    found = auto_mac(shapes(1))
    np.testing.assert_allclose(found, found.T, atol=1e-12)
    np.testing.assert_allclose(np.diag(found), 1.0, atol=1e-12)


def test_coordinate_mac_ignores_scale_and_points_at_the_channel_that_differs():
    one = shapes(2).real
    other = one * np.array([2.0, -3.0, 0.5])
    np.testing.assert_allclose(coordinate_mac(one, other), 1.0, atol=1e-12)
    swapped = one.copy()
    swapped[4] = one[4, [1, 2, 0]]
    assert np.argmin(coordinate_mac(one, swapped)) == 4


def test_subspace_mac_ignores_the_basis_and_is_the_mac_of_single_shapes():
    one, turn = shapes(3), shapes(4, 3, 3)
    assert subspace_mac(one @ turn, one) == pytest.approx(1.0, abs=1e-12)
    a, b = shapes(5)[:, 0], shapes(6)[:, 0]
    assert subspace_mac(a[:, None], b[:, None]) == pytest.approx(mac(a, b), abs=1e-12)
    assert subspace_mac(a[:, None], one) < 1.0


def test_sets_that_cannot_be_compared_are_refused():
    with pytest.raises(ValueError, match="same channels, and at least as many"):
        subspace_mac(shapes(1), shapes(1)[:, :2])
