import numpy as np
import pytest

from slowtime.signals.clock.lower_hull import MOST, Point, extend, joined, lowest


def hull_of(points):
    hull: list[Point] = []
    for point in points:
        extend(hull, point)
    return tuple(hull)


@pytest.fixture
def points():
    rng = np.random.default_rng(2)
    return list(zip(np.arange(300) / 10, rng.exponential(size=300), strict=True))


@pytest.mark.parametrize("slope", [-0.05, -0.001, 0.0, 0.02, 0.05])
def test_the_lowest_point_along_any_slope_is_a_vertex(points, slope):
    expected = min(y - slope * x for x, y in points)
    x, y = lowest(hull_of(points), slope)
    assert y - slope * x == expected


def test_hulls_joined_are_the_hull_of_all(points):
    assert joined(hull_of(points[:120]), hull_of(points[120:])) == hull_of(points)


def test_a_hull_of_many_vertices_is_kept_short():
    convex = hull_of((x, (x - 50.0) ** 2) for x in np.arange(100.0))
    assert len(convex) == MOST
    assert (convex[0][0], convex[-1][0]) == (0.0, 99.0)
