import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from slowtime.dynamics.effects.compiled import ROUND, compiled, sum_rows


@compiled
def _sum(found, start, shares, count, rows, column):
    width = rows.shape[1]
    sum_rows(
        found.ctypes.data,
        start.ctypes.data,
        shares.ctypes.data,
        count,
        rows.ctypes.data + 8 * column,
        width,
    )


@hypothesis.given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 40),
    column=st.integers(0, 9),
    more=st.integers(0, 9),
)
def test_a_round_of_columns_is_summed_and_nothing_beside_it(seed, count, column, more):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((max(count, 1), column + ROUND + more))
    shares, start = rng.standard_normal(max(count, 1)), rng.standard_normal(ROUND)
    found = np.full(ROUND + 2, 7.0)
    _sum(found, start, shares, count, rows, column)
    due = start + shares[:count] @ rows[:count, column : column + ROUND]
    assert found[:ROUND] == pytest.approx(due, rel=1e-12, abs=1e-12)
    assert (found[ROUND:] == 7.0).all()
