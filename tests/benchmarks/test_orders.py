"""Accounts of the bench of orders, against cases worked by hand."""

import dataclasses

import numpy as np
import pytest

from benchmarks.methods.calibration import histories
from benchmarks.methods.calibration.orders import (
    LEAD,
    RATIO,
    interval_of,
    paid,
    table,
    with_foresight,
)

CASE = histories.case("linear", 0, 1)


@pytest.mark.parametrize(
    ("crossed", "ordered", "cost"),
    [
        (np.inf, None, 0.0),
        (np.inf, 0.6, 1.0),
        (0.8, None, RATIO),
        (0.8, 0.8 - LEAD - 0.01, 1.0),
        (0.8, 0.8 - LEAD + 0.01, RATIO),
        (np.inf, 1.0 - LEAD / 2, 0.0),  # takes effect after the end
    ],
)
def test_an_account_ends_with_the_repair_or_the_failure_that_comes_first(
    crossed, ordered, cost
):
    level = -10.0 if crossed == np.inf else float(np.interp(crossed, CASE.fine, CASE.truth))
    case = dataclasses.replace(CASE, threshold=level)
    assert paid(case, ordered) == cost


def test_the_table_gives_means_and_their_ratio():
    one = {"law": "linear", "number": 0, "crossed": 0.9, "ordered": {"plan": 0.7}}
    rows = [
        one | {"plan": 1.0, "oracle": 1.0, "without lead": RATIO},
        one | {"plan": 1.0, "oracle": 0.0, "without lead": 0.0, "crossed": None},
    ]
    text, ratio = table(rows)
    assert ratio == pytest.approx(2.0)
    assert "| linear | 2 | 1 | 1.00 | 0.50 | 2.00 | 5.00 | 0.50 | 2, 0 | 0, 0, 1 |" in text
    low, high = interval_of(rows)
    assert low <= 2.0 <= high
    assert [with_foresight(row) for row in rows] == [1.0, 0.0]
    assert with_foresight(one | {"crossed": 0.55}) == RATIO
