r"""Prediction of a tracked frequency by a bank of random walks.

.. math:: \ln f_{t+1} = \ln f_t + q_k \, w_t, \qquad
          \ln \hat f_t = \ln f_t + s_t \, e_t, \qquad w \sim N(0, 1),\ e \sim t_4

How fast a structure drifts is not known beforehand and changes with the season, so several
speeds :math:`q_k` run side by side, each weighed by how well it has foretold the readings.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

SPEEDS = np.array([1e-5, 1e-4, 3e-4, 1e-3, 3e-3])
"""Relative drift of a frequency over one epoch, one standard deviation each [1]."""

TAIL = 4.0
"""Degrees of freedom of the errors of readings: outliers happen, and must not pull."""

FORGET = 0.98
"""Factor per reading on the log-weights of the bank [1], so that a long calm period does not
rule out fast drift."""

FLOOR = 1e-6
"""Least relative standard deviation of a reading [1]: exact data would leave nothing to
compare."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FrequencyBelief:
    """Logarithm of a frequency in hertz as each member of the bank believes it."""

    level: Float[np.ndarray, " speed"]
    variance: Float[np.ndarray, " speed"]
    log_weight: Float[np.ndarray, " speed"]

    @property
    def mean(self) -> float:
        """Mean of the mixture."""
        return float(np.exp(self.log_weight) @ self.level)

    @property
    def sd(self) -> float:
        """Standard deviation of the mixture."""
        weight = np.exp(self.log_weight)
        return float(np.sqrt(weight @ (self.variance + (self.level - self.mean) ** 2)))


def initial_belief(frequency_hz: float, sd_hz: float) -> FrequencyBelief:
    """Belief from the first reading, with equal weights of all speeds."""
    count = len(SPEEDS)
    sd = max(sd_hz / frequency_hz, FLOOR)
    return FrequencyBelief(
        np.full(count, np.log(frequency_hz)),
        np.full(count, sd**2),
        np.full(count, -np.log(count)),
    )


def predict_belief(belief: FrequencyBelief, elapsed: float) -> FrequencyBelief:
    """Predict the belief without a reading."""
    return dataclasses.replace(belief, variance=belief.variance + SPEEDS**2 * elapsed)


def log_density(belief: FrequencyBelief, frequency_hz: float, sd_hz: float) -> float:
    """Predictive log-density of a reading, per unit of the logarithm of frequency."""
    return float(np.logaddexp.reduce(belief.log_weight + _each(belief, frequency_hz, sd_hz)))


def update(belief: FrequencyBelief, frequency_hz: float, sd_hz: float) -> FrequencyBelief:
    """Update by a reading; outliers have a reduced weight (Student errors)."""
    noise = max(sd_hz / frequency_hz, FLOOR) ** 2
    residual = np.log(frequency_hz) - belief.level
    surprise = residual**2 / (belief.variance + noise)
    trust = np.minimum((TAIL + 1.0) / (TAIL + surprise), 1.0)
    gain = belief.variance / (belief.variance + noise / trust)
    weight = FORGET * belief.log_weight + _each(belief, frequency_hz, sd_hz)
    return FrequencyBelief(
        belief.level + gain * residual,
        belief.variance * (1.0 - gain),
        weight - np.logaddexp.reduce(weight),
    )


def student(
    squared: float | np.ndarray, scale_squared: float | np.ndarray, dimensions: int
) -> np.ndarray:
    """Log-density of an isotropic Student law with `TAIL` degrees of freedom.

    The scale is that along each dimension.
    """
    half = 0.5 * (TAIL + dimensions)
    constant = gammaln(half) - gammaln(0.5 * TAIL)
    spread = 0.5 * dimensions * np.log(TAIL * np.pi * scale_squared)
    return np.asarray(constant - spread - half * np.log1p(squared / (TAIL * scale_squared)))


def _each(belief: FrequencyBelief, frequency_hz: float, sd_hz: float) -> np.ndarray:
    noise = max(sd_hz / frequency_hz, FLOOR) ** 2
    squared = (np.log(frequency_hz) - belief.level) ** 2
    return student(squared, belief.variance + noise, 1)
