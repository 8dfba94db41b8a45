r"""Running mean of the shape of a tracked mode, and its scatter.

Two shapes are compared by the sine of the angle between them,
:math:`d^2 = 1 - \mathrm{MAC}`, against the variances that both are said to have. With n
channels a shape deviates in n - 1 directions; one channel says nothing.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import gammaln

from .frequency import TAIL, student

DRIFT = 0.01
"""Change of a unit shape over one epoch, one standard deviation [1]."""

FLOOR = 0.01
"""Least deviation of a unit shape from one epoch to the next, whatever its stated sd [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapeBelief:
    """A shape of unit norm, and the variance of its deviation over all channels together."""

    shape: Complex[np.ndarray, " channel"]
    variance: float

    @property
    def directions(self) -> int:
        """In how many directions the shape can deviate."""
        return len(self.shape) - 1


def initial_belief(
    shape: Complex[np.ndarray, " channel"], sd: Float[np.ndarray, " channel"]
) -> ShapeBelief:
    """Belief from the first shape."""
    return ShapeBelief(shape / np.linalg.norm(shape), _variance(sd))


def predict_belief(belief: ShapeBelief, elapsed: float) -> ShapeBelief:
    """Predict the belief without a shape."""
    return dataclasses.replace(belief, variance=belief.variance + DRIFT**2 * elapsed)


def alike(belief: ShapeBelief, shape: Complex[np.ndarray, " channel"]) -> float:
    """MAC of the believed shape and another."""
    overlap = np.abs(np.vdot(belief.shape, shape)) / np.linalg.norm(shape)
    return float(min(overlap**2, 1.0))


def log_ratio(
    belief: ShapeBelief,
    shape: Complex[np.ndarray, " channel"],
    sd: Float[np.ndarray, " channel"],
) -> float:
    """Log-likelihood ratio of a shape: this mode against any shape."""
    n = belief.directions
    if n == 0:
        return 0.0
    scale = (belief.variance + _variance(sd)) / n
    own = float(student(1.0 - alike(belief, shape), scale, n))
    # All real shapes of unit norm, sign apart: half of the unit sphere.
    half_sphere = 0.5 * (n + 1) * np.log(np.pi) - gammaln(0.5 * (n + 1))
    return own + float(half_sphere)


def update(
    belief: ShapeBelief,
    shape: Complex[np.ndarray, " channel"],
    sd: Float[np.ndarray, " channel"],
) -> ShapeBelief:
    """Update by a shape, rotated to the phase of the belief; outliers count less."""
    n = belief.directions
    if n == 0:
        return belief
    overlap = np.vdot(belief.shape, shape)
    turned = shape * np.conj(overlap) / max(np.abs(overlap), 1e-300) / np.linalg.norm(shape)
    noise = _variance(sd)
    surprise = n * (1.0 - alike(belief, shape)) / (belief.variance + noise)
    trust = min((TAIL + n) / (TAIL + surprise), 1.0)
    gain = belief.variance / (belief.variance + noise / trust)
    mean = belief.shape + gain * (turned - belief.shape)
    return ShapeBelief(mean / np.linalg.norm(mean), belief.variance * (1.0 - gain))


def _variance(sd: Float[np.ndarray, " channel"]) -> float:
    total = float(np.sum(np.square(sd)))
    return FLOOR**2 + (total if np.isfinite(total) else 1.0)
