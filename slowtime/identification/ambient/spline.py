"""Cubic spline interpolation with not-a-knot end conditions."""

import numpy as np
from jaxtyping import Float


def cubic_spline(
    places: Float[np.ndarray, " knot"],
    values: Float[np.ndarray, " knot"],
    at: Float[np.ndarray, " place"],
) -> Float[np.ndarray, " place"]:
    """Piecewise cubic of continuous curvature, without a kink at the outermost inner knots.

    `scipy.interpolate.CubicSpline` of its usual end condition, whose import brings SciPy's
    optimisation and spatial trees to an edge agent.

    Examples
    --------
    >>> places = np.array([0.0, 1.0, 3.0, 4.0])
    >>> cubic_spline(places, places**3, np.array([2.0])).round(9)
    array([8.])
    """
    gap = np.diff(places)
    rise = np.diff(values) / gap
    count = len(places)
    matrix, right = np.zeros((count, count)), np.zeros(count)
    inner = np.arange(1, count - 1)
    matrix[inner, inner - 1] = gap[1:]
    matrix[inner, inner] = 2 * (gap[:-1] + gap[1:])
    matrix[inner, inner + 1] = gap[:-1]
    right[1:-1] = 3 * (gap[1:] * rise[:-1] + gap[:-1] * rise[1:])
    span = places[2] - places[0]
    matrix[0, :2] = gap[1], span
    right[0] = ((gap[0] + 2 * span) * gap[1] * rise[0] + gap[0] ** 2 * rise[1]) / span
    span = places[-1] - places[-3]
    matrix[-1, -2:] = span, gap[-2]
    right[-1] = (gap[-1] ** 2 * rise[-2] + (2 * span + gap[-1]) * gap[-2] * rise[-1]) / span
    slope = np.linalg.solve(matrix, right)
    piece = np.clip(np.searchsorted(places, at, side="right") - 1, 0, count - 2)
    width = gap[piece]
    part = (at - places[piece]) / width
    start, end = slope[piece] - rise[piece], slope[piece + 1] - rise[piece]
    bend = part * (1 - part) * width * ((1 - part) * start - part * end)
    return np.asarray(values[piece] + part * width * rise[piece] + bend)
