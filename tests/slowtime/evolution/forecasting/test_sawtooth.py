"""Least squares of sawtooth edges against the sawtooth written out, reading by reading."""

import numpy as np
import pytest

from slowtime.evolution.forecasting import sawtooth


@pytest.mark.parametrize("period", [7.3, 41.0, 260.0])
def test_squares_left_are_those_of_a_regression_on_each_sawtooth(period):
    rng = np.random.default_rng(1)
    time = 5.0 + np.sort(rng.uniform(0.0, 300.0, 200))
    value, weight = rng.standard_normal(200), rng.uniform(0.5, 2.0, 200)
    edges = 150.0 + np.arange(-0.5 * period, 0.5 * period, period / 9)
    found = sawtooth._left_by(time, value, weight, period, edges)
    turn = 2 * np.pi * time / period
    smooth = [
        np.ones(200),
        time,
        time**2,
        *(f(k * turn) for k in (1, 2) for f in (np.cos, np.sin)),
    ]
    for edge, squares in zip(edges, found, strict=True):
        columns = np.column_stack([*smooth, ((time - edge) / period) % 1.0])
        scaled = columns * weight[:, None] / np.abs(columns).max(axis=0)
        rest = value * weight
        rest = rest - scaled @ np.linalg.lstsq(scaled, rest, rcond=None)[0]
        assert squares == pytest.approx(rest @ rest, rel=1e-9)


def test_an_edge_is_found_where_it_is():
    rng = np.random.default_rng(2)
    time = np.arange(400.0)
    value = ((time - 31.4) / 90.0) % 1.0 + 0.05 * rng.standard_normal(400)
    period, edge = sawtooth.places(time, value, np.full(400, 0.05), 91.0)[0]
    assert period == pytest.approx(90.0, abs=0.3)
    assert (edge - 31.4 + 45.0) % 90.0 - 45.0 == pytest.approx(0.0, abs=1.0)
