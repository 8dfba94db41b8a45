import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.families import group_into_families


def measured(frequencies, sd=1e-3):
    return tuple(Measured(float(f), sd) for f in frequencies)


@given(
    base=st.floats(2.0, 30.0),
    orders=st.sets(st.integers(1, 8), min_size=3, max_size=6),
    seed=st.integers(0, 2**32 - 1),
)
def test_multiples_of_a_base_are_a_family_of_it(base, orders, seed):
    order = np.array(sorted(orders))
    order = order // np.gcd.reduce(order)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(order))
    found = group_into_families(
        measured(base * order + np.clip(noise, -2e-3, 2e-3)), resolution_hz=0.002
    )
    assert found[0].orders == tuple(order)
    assert found[0].base_hz.value == pytest.approx(base, abs=4 * found[0].base_hz.sd)


def test_unrelated_lines_are_a_family_as_rarely_as_stated():
    rng = np.random.default_rng(1)
    found = [
        group_into_families(
            measured(np.sort(rng.uniform(2.0, 40.0, 6)), 2e-3), resolution_hz=0.005
        )
        for _ in range(300)
    ]
    assert np.mean([len(f) > 0 for f in found]) < 0.02


def test_two_machines_are_two_families_and_a_stranger_none():
    lines = measured([7.3, 14.6, 21.9, 9.41, 18.82, 28.23, 11.117])
    found = group_into_families(lines, resolution_hz=0.002)
    assert sorted(round(f.base_hz.value, 2) for f in found) == [7.3, 9.41]
    assert {m for f in found for m in f.members} == set(range(6))


def test_a_lone_line_is_no_family():
    assert group_into_families(measured([12.0]), resolution_hz=0.01) == ()
    assert group_into_families((), resolution_hz=0.01) == ()
