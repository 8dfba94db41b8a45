r"""Residual of the covariate model: an autoregressive part and measurement noise.

.. math:: y_t = \phi(c_t)^T \beta + a(t) + \varepsilon_t, \qquad
          \mathrm{E}\, a(t) a(t') = \sigma_a^2 e^{-|t - t'| / \tau}, \quad
          \varepsilon_t \sim N(0, s_t^2 + \sigma_w^2)

The inverse covariance of a(t) is tridiagonal at any instants, so that the likelihood, with
:math:`\beta` integrated out, takes time proportional to the number of readings.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_solve_banded, cholesky_banded

_CLOSEST = 1e-9  # least share of the variance of a(t) that is new at the next instant


@dataclasses.dataclass(frozen=True, slots=True)
class ResidualProcess:
    """Memory [slow time] and standard deviation of a(t); sd of noise beyond the stated one."""

    memory: float
    sd: float
    noise: float

    def kept(self, elapsed: float | np.ndarray) -> np.ndarray:
        """Autocorrelation of a(t) at a lag [1].

        Parameters
        ----------
        elapsed
            Lag [slow time].
        """
        return np.asarray(np.exp(-np.asarray(elapsed) / self.memory))


def log_evidence(
    wander: ResidualProcess,
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
    features: Float[np.ndarray, "time coefficient"],
) -> float:
    """Log-likelihood of readings at ascending times, coefficients integrated out.

    Parameters
    ----------
    time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.
    features
        Basis functions, one row per reading.
    """
    variance = sd**2 + wander.noise**2
    kept = wander.kept(np.diff(time))
    fresh = wander.sd**2 * np.maximum(1.0 - kept**2, _CLOSEST)
    precision = 1.0 / variance
    precision[0] += 1.0 / wander.sd**2
    precision[1:] += 1.0 / fresh
    precision[:-1] += kept**2 / fresh
    banded = np.array([np.concatenate([[0.0], -kept / fresh]), precision])
    factor = cholesky_banded(banded)
    both = np.column_stack([value, features])
    weighted = both / variance[:, None]
    solved = weighted - cho_solve_banded((factor, False), weighted) / variance[:, None]
    gram = both.T @ solved
    log_determinant = (
        np.log(variance).sum()
        + 2.0 * np.log(wander.sd)
        + np.log(fresh).sum()
        + 2.0 * np.log(factor[1]).sum()
    )
    normal = np.eye(features.shape[1]) + gram[1:, 1:]
    lower = np.linalg.cholesky(normal)
    explained = np.linalg.solve(lower, gram[1:, 0])
    quadratic = gram[0, 0] - explained @ explained
    log_determinant += 2.0 * np.log(np.diag(lower)).sum()
    return float(-0.5 * (quadratic + log_determinant + len(time) * np.log(2.0 * np.pi)))
