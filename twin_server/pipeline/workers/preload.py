"""Loads and compiles in a worker process what forecasts need, before the first call."""

import contextlib
import gc
import os

import numpy as np

from twin_server.estimate import forecast_changes, learn
from twin_server.estimate.forecast.changes import Past

from .processes import WARMED

_COUNT = 40
"""Readings of the history that is forecast to compile what forecasts need."""


def warm() -> None:
    """Forecast once, so that all code is loaded and compiled."""
    time = np.arange(float(_COUNT))
    value = 1e-3 * np.random.default_rng(0).standard_normal(_COUNT)
    past = {"stiffness_change": Past(time, value, np.full(_COUNT, 1e-3), 0.0)}
    forecast_changes(past, learn(past), None, 2)


if WARMED in os.environ:
    with contextlib.suppress(Exception):  # the first request will say what is wrong
        warm()
    gc.collect()
    gc.freeze()
