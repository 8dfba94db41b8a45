import dataclasses

import numpy as np
import pytest

from slowtime.identification.subspace.ssi import Poles
from slowtime.identification.subspace.stabilisation import find_stable_poles

ORDERS = 20
DURATION_S = 500.0
ONE, OTHER = np.array([1.0, 0.5, -0.3]), np.array([0.4, -1.0, 0.2])
BAND = {"low_hz": 1.0, "high_hz": 10.0}


def poles(*parts):
    """Put poles together, each given as (order, frequency [Hz], damping, shape, sd [Hz])."""
    order, frequency, damping, shape, sd = (np.array(each) for each in zip(*parts, strict=True))
    omega = 2 * np.pi * frequency.astype(float)
    damping = damping.astype(float)
    pole = omega * (-damping + 1j * np.sqrt(1 - damping**2))
    # Errors of frequency and of decay of the same size, of random signs.
    signs = np.sign(np.random.default_rng(1).standard_normal((2, 12, len(order))))
    draws = 2 * np.pi * sd * (signs[0] + 1j * signs[1])
    unit = shape.astype(complex).T / np.linalg.norm(shape, axis=1)
    return Poles(order.astype(int), pole, unit, draws, None, DURATION_S)


def staying(
    frequency, *, shape=ONE, orders=range(1, ORDERS + 1), sd=0.005, seed=2, damping=0.02
):
    """One pole that every order shows, within its error."""
    rng = np.random.default_rng(seed)
    return [
        (n, frequency + 0.5 * sd * rng.standard_normal(), damping, shape, sd) for n in orders
    ]


def scattered(seed=3, each=2):
    """Poles of no meaning, anywhere at every order."""
    rng = np.random.default_rng(seed)
    return [
        (n, rng.uniform(1.0, 10.0), 0.02, rng.standard_normal(3), 0.005)
        for n in range(1, ORDERS + 1)
        for _ in range(each)
    ]


def frequencies(given, **band):
    return [c.frequency_hz for c in find_stable_poles(given, **(BAND | band))]


def test_what_stays_over_orders_is_a_candidate_and_what_jumps_is_none():
    given = poles(*staying(3.0), *scattered())
    (only,) = find_stable_poles(given, **BAND)
    assert only.frequency_hz == pytest.approx(3.0, abs=0.005)
    assert only.damping_ratio == pytest.approx(0.02, rel=1e-6)
    assert only.orders >= ORDERS - 2
    assert 0.9 < only.share <= 1.0


def test_a_candidate_is_one_of_its_members_and_they_are_the_poles_it_followed():
    given = poles(*staying(3.0), *scattered())
    (only,) = find_stable_poles(given, **BAND)
    assert only.index in only.members
    assert only.pole == given.pole[only.index]
    assert len(set(given.order[only.members].tolist())) == len(only.members) == only.orders
    np.testing.assert_allclose(given.frequency_hz[only.members], 3.0, atol=0.02)


def test_the_order_in_which_poles_are_listed_does_not_matter():
    given = poles(*staying(3.0), *staying(5.0, seed=7), *scattered())
    mixed = np.random.default_rng(4).permutation(len(given.order))
    shuffled = dataclasses.replace(
        given,
        order=given.order[mixed],
        pole=given.pole[mixed],
        shape=given.shape[:, mixed],
        draws=given.draws[:, mixed],
    )
    assert frequencies(shuffled) == frequencies(given)


def test_a_pole_may_be_missing_at_a_few_orders_but_not_at_most():
    few = [n for n in range(1, ORDERS + 1) if n not in (5, 6, 11)]
    assert len(frequencies(poles(*staying(3.0, orders=few)))) == 1
    assert frequencies(poles(*staying(3.0, orders=range(1, ORDERS + 1, 3)))) == []
    assert frequencies(poles(*staying(3.0, orders=range(14, 18)))) == []


def test_poles_of_unlike_shapes_are_not_followed_into_each_other():
    halves = staying(3.0, orders=range(1, 6)) + staying(3.0, shape=OTHER, orders=range(6, 12))
    assert frequencies(poles(*halves)) == []
    assert len(frequencies(poles(*staying(3.0, orders=range(1, 12))))) == 1


def test_two_modes_closer_than_their_bandwidth_are_two_where_their_shapes_differ():
    close = staying(3.0, sd=0.002) + staying(3.02, shape=OTHER, sd=0.002, seed=5)
    np.testing.assert_allclose(frequencies(poles(*close)), [3.0, 3.02], atol=0.004)
    same = staying(3.0, sd=0.002) + staying(3.02, sd=0.002, seed=5)
    assert len(frequencies(poles(*same))) == 1


def test_a_drift_that_the_errors_do_not_allow_for_is_no_candidate():
    drifting = [(n, 3.0 + 0.03 * n, 0.02, ONE, 0.005) for n in range(1, ORDERS + 1)]
    assert frequencies(poles(*drifting)) == []
    allowed = [(n, 3.0 + 0.03 * n, 0.02, ONE, 0.03) for n in range(1, ORDERS + 1)]
    assert len(frequencies(poles(*allowed))) == 1


@pytest.mark.parametrize("damping", [-0.01, 0.4])
def test_poles_that_grow_or_hardly_ring_are_none(damping):
    assert frequencies(poles(*staying(3.0, damping=damping))) == []


def test_a_pole_known_no_better_than_its_bandwidth_is_none():
    assert frequencies(poles(*staying(3.0, sd=0.5))) == []


def test_candidates_lie_in_the_band_and_ascend():
    given = poles(*staying(8.0, seed=7), *staying(3.0), *staying(5.0, seed=8))
    found = frequencies(given)
    assert found == sorted(found)
    assert len(found) == 3
    assert len(frequencies(given, low_hz=4.0, high_hz=6.0)) == 1


def test_no_poles_give_no_candidates():
    assert find_stable_poles(poles(*staying(30.0)), **BAND) == []
