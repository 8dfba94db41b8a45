"""Recursive filters are those of another library, however the stream is cut."""

import numpy as np
import pytest
import scipy.signal as sps
from hypothesis import given
from hypothesis import strategies as st

from slowtime.signals.recursive_filters import (
    BLOCK,
    at_rest,
    butterworth,
    chebyshev,
    filtered,
    first_order,
)

KINDS = ("lowpass", "highpass")


def gain(sections):
    return sps.sosfreqz(sections, np.linspace(1e-3, 3.14, 400))[1]


@pytest.mark.parametrize("order", range(1, 13))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("edge", [0.001, 0.1, 0.45, 0.9])
def test_butterworth_is_that_of_scipy(order, kind, edge):
    theirs = sps.butter(order, edge, kind, output="sos")
    np.testing.assert_allclose(gain(butterworth(order, edge, kind)), gain(theirs), atol=1e-6)


@pytest.mark.parametrize("edge", [0.0008, 0.08, 0.4])
def test_chebyshev_is_that_of_scipy(edge):
    theirs = sps.cheby1(8, 0.05, edge, output="sos")
    np.testing.assert_allclose(gain(chebyshev(8, 0.05, edge)), gain(theirs), atol=1e-8)


@given(
    order=st.integers(1, 8),
    edge=st.floats(0.01, 0.9),
    kind=st.sampled_from(KINDS),
    count=st.integers(1, 4 * BLOCK),
    seed=st.integers(0, 99),
)
def test_rows_are_filtered_as_by_scipy(order, edge, kind, count, seed):
    sections = butterworth(order, edge, kind)
    rows = np.random.default_rng(seed).standard_normal((count, 2)) + 5.0
    ours = filtered(sections, rows, at_rest(sections)[:, :, None] * rows[0])
    rest = sps.sosfilt_zi(sections)[:, :, None] * rows[0]
    theirs = sps.sosfilt(sections, rows, axis=0, zi=rest)
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7)


@given(st.sets(st.integers(1, 599), max_size=5))
def test_cutting_the_rows_anywhere_changes_nothing(cuts):
    sections = butterworth(6, 0.2, "highpass")
    rows = np.random.default_rng(3).standard_normal((600, 3))
    memory = np.zeros((len(sections), 2, 3))
    whole, last = filtered(sections, rows, memory)
    parts = []
    for part in np.split(rows, sorted(cuts)):
        done, memory = filtered(sections, part, memory)
        parts.append(done)
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-12)
    np.testing.assert_allclose(memory, last, atol=1e-12)


@pytest.mark.parametrize("kind", ["<f8", "<c8"])
@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9999])
@pytest.mark.parametrize("count", [1, BLOCK, 1000])
def test_a_recursion_of_first_order_is_that_of_scipy(kind, pole, count):
    series = np.random.default_rng(4).standard_normal((3, count)).astype(kind)
    theirs = sps.lfilter([1.0], [1.0, -pole], series)
    ours = first_order(series, pole)
    assert ours.dtype == series.dtype
    close = 1e-10 if kind == "<f8" else 1e-4 * np.abs(theirs).max()
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=close)
