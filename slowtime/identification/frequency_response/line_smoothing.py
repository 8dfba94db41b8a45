"""Power averaged over neighbouring lines."""

import numpy as np
from jaxtyping import Float

HALF_WIDTH = 15
"""[rows] On either side that are averaged: a standard deviation from 31 complex values has an
error of 9 %, and costs 3 % of efficiency where it serves as a weight."""


def smoothed_power(
    power: Float[np.ndarray, "row entry"], weight: Float[np.ndarray, "row entry"]
) -> Float[np.ndarray, "row entry"]:
    """Return sums of power over sums of weights, the expected shares of noise, by rows."""
    rows = len(power)
    half_width = min(HALF_WIDTH, max(1, rows // 4))
    low = np.maximum(np.arange(rows) - half_width, 0)
    high = np.minimum(np.arange(rows) + half_width + 1, rows)
    sums = []
    for values in (power, weight):
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        sums.append(total[high] - total[low])
    return np.asarray(sums[0] / np.maximum(sums[1], 1e-300))
