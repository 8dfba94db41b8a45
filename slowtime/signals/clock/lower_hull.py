"""Lower convex hull of points that arrive in order.

Messages arrive late, never early, so that the true clock is a line below all points (sample
time, arrival). For every slope the lowest point is a vertex of the lower convex hull, which is
therefore all that has to be kept of a span of messages.

References
----------
.. [1] S. B. Moon, P. Skelly, D. Towsley, "Estimation and removal of clock skew from network
   delay measurements", Proc. IEEE INFOCOM (1999) 227-234.
.. [2] L. Zhang, Z. Liu, C. H. Xia, "Clock synchronization algorithms for network
   measurements", Proc. IEEE INFOCOM (2002) 160-169.
"""

from collections.abc import Iterable

Point = tuple[float, float]

MOST = 16
"""Vertices kept; the hull of a million random delays has about ln(10^6) = 14."""


def extend(hull: list[Point], point: Point) -> None:
    """Add a point right of all others to a hull, in place.

    Parameters
    ----------
    hull
        Vertices, ascending in their first coordinate, with ascending slopes between them.
    point
        Its first coordinate is greater than that of every vertex.
    """
    while len(hull) > 1 and _area(hull[-2], hull[-1], point) <= 0:
        hull.pop()
    hull.append(point)
    if len(hull) > MOST:
        areas = [
            _area(*hull[middle - 1 : middle + 2])  # the vertex that shapes the hull least
            for middle in range(1, len(hull) - 1)
        ]
        del hull[1 + areas.index(min(areas))]


def joined(left: Iterable[Point], right: Iterable[Point]) -> tuple[Point, ...]:
    """Lower hull of two hulls, the second right of the first.

    Parameters
    ----------
    left, right
        Vertices (sensor time, delay) of both hulls [s].

    Returns
    -------
    Vertices of the joined hull [s].
    """
    hull = list(left)
    for point in right:
        extend(hull, point)
    return tuple(hull)


def lowest(hull: Iterable[Point], slope: float) -> Point:
    """Vertex of a hull that is lowest above a line of the given slope.

    Parameters
    ----------
    hull
        Vertices (sensor time, delay) [s].
    slope
        Slope of the line [1].

    Returns
    -------
    The vertex [s].
    """
    return min(hull, key=lambda point: point[1] - slope * point[0])


def _area(a: Point, b: Point, c: Point) -> float:
    """Twice the signed area of a triangle; positive where b lies below the chord a-c."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
