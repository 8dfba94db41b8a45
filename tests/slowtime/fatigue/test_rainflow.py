"""Rainflow counts: the standard's example, the three-point rule, streams cut anywhere."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.fatigue.counter import Count, Counter
from slowtime.fatigue.curves import SNCurve
from slowtime.fatigue.cycles import rainflow, turning_points
from slowtime.fatigue.histogram import Histogram
from slowtime.fatigue.mean_stress import MeanStress

CURVE = SNCurve(constant=1e6, slope=3.0, knee=2.0, lower_slope=5.0)


def three_point_rule(series):
    """ASTM E1049, 5.4.4.1, word for word: (range, count) of each cycle."""
    found, points = [], []
    for point in turning_points(np.asarray(series, float)).tolist():
        points.append(point)
        while len(points) >= 3:
            x, y = abs(points[-1] - points[-2]), abs(points[-2] - points[-3])
            if x < y:
                break
            if len(points) == 3:
                found.append((y, 0.5))
                del points[0]
            else:
                found.append((y, 1.0))
                del points[-3:-1]
    found += [(abs(b - a), 0.5) for a, b in itertools.pairwise(points)]
    return tally(found)


def tally(pairs):
    sums: dict[float, float] = {}
    for size, count in pairs:
        sums[round(size, 9)] = sums.get(round(size, 9), 0.0) + count
    return sums


def counted(series):
    cycles = rainflow(np.asarray(series, float))
    return tally(zip(cycles.ranges.tolist(), cycles.counts.tolist(), strict=True))


def test_the_worked_example_of_the_standard_is_exact():
    example = [-2, 1, -3, 5, -1, 3, -4, 4, -2]
    assert counted(example) == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}


@pytest.mark.parametrize("kind", ["white", "walk", "whole numbers", "nested", "growing"])
def test_vectorised_passes_count_as_the_three_point_rule_does(kind):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        white = rng.standard_normal(3000)
        series = {
            "white": white,
            "walk": np.cumsum(white),
            "whole numbers": np.round(2 * white),
            "nested": np.where(np.arange(300) % 2, 1, -1) * np.abs(np.arange(300) - 150.0),
            "growing": np.where(np.arange(300) % 2, 1, -1) * np.arange(300.0),
        }[kind]
        assert counted(series) == three_point_rule(series)


@given(st.lists(st.integers(-4, 4), max_size=60))
def test_any_short_series_is_counted_by_the_rule(series):
    assert counted(series) == three_point_rule(series)


@given(
    where=st.sets(st.integers(1, 1999), max_size=12),
    seed=st.integers(0, 50),
    coarse=st.booleans(),
)
def test_cutting_the_stream_anywhere_changes_nothing(where, seed, coarse):
    rng = np.random.default_rng(seed)
    series = np.cumsum(rng.standard_normal(2000)) * np.linspace(2, 0.2, 2000)
    series = np.round(series) if coarse else series
    counter = Counter(curve=CURVE, mean_stress=MeanStress(rule="goodman", strength=400.0))
    whole, count = counter.step(Count(), series), Count()
    for part in np.split(series, sorted(where)):
        count = counter.step(count, part)
    assert count.histogram == whole.histogram
    assert counter.total(count) == counter.total(whole)
    assert counter.miner(count).median == pytest.approx(counter.miner(whole).median, rel=1e-9)
    np.testing.assert_array_equal(count.residue, whole.residue)


def test_closed_damage_never_falls_and_residues_stay_short():
    rng, counter, count = np.random.default_rng(3), Counter(curve=CURVE), Count()
    before = 0.0
    for _ in range(200):
        count = counter.step(count, rng.standard_normal(500))
        assert count.damage >= before
        before = count.damage
        assert len(count.residue) < 100


def test_histograms_of_parts_add_up_in_any_order_and_hold_the_damage():
    rng = np.random.default_rng(5)
    parts = [Histogram.of(rainflow(rng.standard_normal(4000))) for _ in range(6)]
    assert Histogram.total(parts) == Histogram.total(parts[::-1])
    cycles = rainflow(rng.standard_normal(100_000))
    histogram = Histogram.of(cycles)
    assert histogram.counts.sum() == cycles.counts.sum()
    for slope in (3.0, 5.0):
        curve = SNCurve(constant=1e6, slope=slope)
        exact = cycles.counts @ curve.damage(cycles.ranges)
        assert histogram.counts @ curve.damage(histogram.ranges) == pytest.approx(
            exact, rel=5e-3
        )


def test_samples_that_are_not_finite_are_skipped_and_counted_or_refused():
    series = np.array([0.0, 2.0, np.nan, -1.0, 3.0])
    count = Counter(curve=CURVE).step(Count(), series)
    assert (count.samples, count.skipped) == (5, 1)
    clean = Counter(curve=CURVE).step(Count(), series[np.isfinite(series)])
    np.testing.assert_array_equal(count.residue, clean.residue)
    with pytest.raises(ValueError, match=r"1 of 5 samples are not finite.*Counter"):
        rainflow(series)


def test_another_library_counts_alike():
    other = pytest.importorskip("rainflow")
    series = np.cumsum(np.random.default_rng(2).standard_normal(5000))
    theirs = tally((cycle[0], cycle[2]) for cycle in other.extract_cycles(series))
    assert counted(series) == theirs
