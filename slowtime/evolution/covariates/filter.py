"""Kalman recursion of covariate coefficients and residual process."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .residual_process import ResidualProcess


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Coefficients and, last, the wandering part, as believed at a slow time."""

    time: float
    mean: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """A reading against what was expected of it.

    Parameters
    ----------
    expected, variance
        Of the reading, before it was read.
    residual
        Reading minus expected.
    seen
        What the reading sees of the state.
    gain
        By which a residual moves the state.
    """

    expected: float
    variance: float
    residual: float
    seen: Float[np.ndarray, " state"]
    gain: Float[np.ndarray, " state"]


def initial_belief(count: int, wander: ResidualProcess, time: float) -> Belief:
    """Belief before any reading, with `count` coefficients."""
    variances = np.append(np.ones(count), wander.sd**2)
    return Belief(time, np.zeros(count + 1), np.diag(variances))


def predict(belief: Belief, wander: ResidualProcess, time: float) -> Belief:
    """Carry on to a later time: the wandering part fades, and wanders on."""
    kept = float(wander.kept(time - belief.time))
    fade = np.ones(len(belief.mean))
    fade[-1] = kept
    covariance = belief.covariance * np.outer(fade, fade)
    covariance[-1, -1] += wander.sd**2 * (1.0 - kept**2)
    return Belief(time, belief.mean * fade, covariance)


def innovation(
    belief: Belief,
    wander: ResidualProcess,
    value: float,
    sd: float,
    features: Float[np.ndarray, " coefficient"],
) -> Innovation:
    """Compare a reading with the belief at its time."""
    seen = np.append(features, 1.0)
    shared = belief.covariance @ seen
    variance = float(seen @ shared) + sd**2 + wander.noise**2
    expected = float(seen @ belief.mean)
    return Innovation(expected, variance, value - expected, seen, shared / variance)


def update(belief: Belief, reading: Innovation) -> Belief:
    """Take in a reading."""
    covariance = belief.covariance - reading.variance * np.outer(reading.gain, reading.gain)
    return Belief(belief.time, belief.mean + reading.gain * reading.residual, covariance)
