"""Draws the futures of a twin: forecast, remaining life, risk and plan are views of them."""

import dataclasses

import numpy as np

from slowtime.degradation import BOUND, Mixture
from slowtime.evolution.life.threshold_crossing import SampledFutures

PATHS = 2000
"""Futures of each quantity [1]: they tell a probability of one half to 1.1 %."""

POINTS = 120
"""Steps from the last reading to the horizon [1]."""


def futures_of(
    laws: Mixture, common: float, horizon: float, widening: float = 1.0
) -> SampledFutures:
    """Draw the futures of one quantity; the same state and horizon give the same futures.

    Parameters
    ----------
    laws
        Degradation laws after the last reading.
    common
        Of the error that all readings share, over 1 + change [1]; each future has one of its
        own.
    horizon
        Slow time up to which is looked.
    widening
        Factor of their spread [1], as past outlooks call for it.

    Returns
    -------
    Futures with that error in them. No change is below -1: they end there, which keeps their
    probability.
    """
    drawn = laws.futures(horizon, points=POINTS, paths=PATHS).widened(widening)
    shared = common * np.abs(1.0 + drawn.paths) * drawn.common[:, None]
    return dataclasses.replace(
        drawn, paths=np.maximum(drawn.paths + shared, BOUND), common=np.zeros(PATHS)
    )


__all__ = ["PATHS", "POINTS", "futures_of"]
