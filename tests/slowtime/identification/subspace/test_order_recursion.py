import dataclasses

import numpy as np
import pytest

from slowtime.identification.subspace.model_orders import WeightedSubspace, poles_of_order
from slowtime.identification.subspace.order_recursion import poles_of_orders
from slowtime.identification.subspace.poles import PoleLimits

ROWS, CHANNELS, ORDERS, DRAWS = 24, 2, 9, 5
CENTRE_HZ = 1.0


def drawn(rng, *shape, complex_valued):
    real = rng.standard_normal(shape)
    return real + 1j * rng.standard_normal(shape) if complex_valued else real


def subspace(seed, *, complex_valued):
    """Subspace of no system in particular, and draws of its errors."""
    rng = np.random.default_rng(seed)
    u = np.linalg.qr(drawn(rng, ROWS, ORDERS, complex_valued=complex_valued))[0]
    weight = drawn(rng, ROWS, ROWS, complex_valued=complex_valued)
    errors = drawn(rng, DRAWS, ROWS, ORDERS, complex_valued=complex_valued)
    return WeightedSubspace(u, weight @ u, errors, weight, CHANNELS, 10.0)


def by_frequency(poles):
    """Poles, errors and moduli of the shapes, whose phase is anybody's choice."""
    _, pole, shape, draws, moves = poles
    assert moves is None
    at = np.argsort(pole.imag)
    return pole[at], draws[:, at], np.abs(shape[:, at])


@pytest.mark.parametrize("complex_valued", [False, True])
def test_all_orders_are_what_each_is_by_a_pseudo_inverse_of_its_own(complex_valued):
    given = subspace(1, complex_valued=complex_valued)
    orders = range(1, ORDERS + 1)
    together = poles_of_orders(given, orders, CENTRE_HZ)
    for n, found in zip(orders, together, strict=True):
        alone = poles_of_order(given, n, CENTRE_HZ, False)
        assert found[0] == n
        assert len(found[1]) == len(alone[1])
        for one, other in zip(by_frequency(found), by_frequency(alone), strict=True):
            scale = np.abs(other).max(initial=0.0)
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9 * scale)


def test_errors_are_computed_within_the_limits_only():
    given = subspace(2, complex_valued=True)
    limits = PoleLimits(0.5, 4.0, most_damping=0.8)
    for n in (ORDERS - 1, ORDERS):
        (found,) = poles_of_orders(given, [n], CENTRE_HZ, limits)
        (every,) = poles_of_orders(given, [n], CENTRE_HZ)
        frequency = np.abs(found[1]) / (2 * np.pi)
        damping = -found[1].real / np.abs(found[1])
        inside = (frequency >= 0.5) & (frequency <= 4.0) & (damping > 0) & (damping < 0.8)
        assert inside.any()
        assert not inside.all()
        np.testing.assert_allclose(found[3][:, inside], every[3][:, inside], rtol=1e-9)
        assert np.isnan(found[3][:, ~inside]).all()


def test_dependent_columns_take_pseudo_inverses():
    given = subspace(3, complex_valued=False)
    gamma = given.gamma.copy()
    gamma[:, -1] = gamma[:, -2]
    given = dataclasses.replace(given, gamma=gamma)
    (found,) = poles_of_orders(given, [ORDERS], CENTRE_HZ)
    alone = poles_of_order(given, ORDERS, CENTRE_HZ, False)
    np.testing.assert_array_equal(found[1], alone[1])
    np.testing.assert_array_equal(found[3], alone[3])
