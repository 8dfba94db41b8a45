"""Correlation of a Matérn process by its formula: truth for other tests."""

import numpy as np


def matern_correlation(smoothness, distance):
    """Correlation across a distance, which is in units of the length scale."""
    s = np.sqrt(2.0 * smoothness) * np.abs(distance)
    return {0.5: 1.0, 1.5: 1.0 + s, 2.5: 1.0 + s + s**2 / 3.0}[smoothness] * np.exp(-s)
