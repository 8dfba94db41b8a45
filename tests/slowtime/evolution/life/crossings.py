"""Crossings of a threshold by the futures of a history, from the readings on."""

import numpy as np

from slowtime.evolution.forecasting import continuation
from slowtime.evolution.life.remaining_life import SHARES
from slowtime.evolution.life.threshold_crossing import draw_futures_at


def draw_futures(begun, horizon, *, points=200, paths=4000, seed=0):
    """Draw futures at equally spaced instants up to a horizon."""
    later = np.linspace(begun.time, horizon, points + 1)
    return draw_futures_at(begun, later, paths=paths, seed=seed)


def first_crossing(
    outlook, time, value, sd, threshold, horizon, *, shares=SHARES, toward=None, **drawn
):
    """Distribution of the time at which the future of a history first crosses a threshold."""
    begun = continuation.begin(outlook, time, value, sd)
    futures = draw_futures(begun, horizon, **drawn)
    return futures.crossing(threshold, shares=shares, toward=toward)
