"""Kalman recursion of covariate coefficients and residual process."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .residual_process import ResidualProcess


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class CovariateBelief:
    """Coefficients and, last, the wandering part, as believed at a slow time."""

    time: float
    mean: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class CovariateInnovation:
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


def initial_belief(count: int, wander: ResidualProcess, time: float) -> CovariateBelief:
    """Belief before any reading.

    Returns
    -------
    Prior mean and covariance.
    """
    variances = np.append(np.ones(count), wander.sd**2)
    return CovariateBelief(time, np.zeros(count + 1), np.diag(variances))


def predict(belief: CovariateBelief, wander: ResidualProcess, time: float) -> CovariateBelief:
    """Predict the belief at a later time.

    Parameters
    ----------
    belief
        Belief before the step.
    wander
        Residual process.
    time
        Later slow time.

    Returns
    -------
    Predicted belief.
    """
    kept = float(wander.kept(time - belief.time))
    fade = np.ones(len(belief.mean))
    fade[-1] = kept
    covariance = belief.covariance * np.outer(fade, fade)
    covariance[-1, -1] += wander.sd**2 * (1.0 - kept**2)
    return CovariateBelief(time, belief.mean * fade, covariance)


def innovation(
    belief: CovariateBelief,
    wander: ResidualProcess,
    value: float,
    sd: float,
    features: Float[np.ndarray, " coefficient"],
) -> CovariateInnovation:
    """Innovation of a reading, with its variance and gain.

    Parameters
    ----------
    value
        Reading.
    sd
        Standard deviation of the reading.
    features
        Basis functions at the reading's covariates.
    """
    seen = np.append(features, 1.0)
    shared = belief.covariance @ seen
    variance = float(seen @ shared) + sd**2 + wander.noise**2
    expected = float(seen @ belief.mean)
    return CovariateInnovation(expected, variance, value - expected, seen, shared / variance)


def update(belief: CovariateBelief, reading: CovariateInnovation) -> CovariateBelief:
    """Update the belief by an innovation.

    Parameters
    ----------
    belief
        Predicted belief.
    reading
        Innovation.

    Returns
    -------
    Updated belief.
    """
    covariance = belief.covariance - reading.variance * np.outer(reading.gain, reading.gain)
    return CovariateBelief(
        belief.time, belief.mean + reading.gain * reading.residual, covariance
    )
