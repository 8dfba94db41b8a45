r"""Marginal likelihood of readings under a linear law, its coefficients integrated out.

.. math:: y \sim N(X \beta, \kappa^2 V), \quad \beta \sim N(0, \kappa^2 P), \quad
          1 / \kappa^2 \sim \Gamma(a_0, a_0)

where V is the covariance of the random process and of the noise as stated. The factor
:math:`\kappa` allows for stated standard deviations that are wrong as a whole. P is as wide as
the scatter of the readings, so that a term that is not needed is penalised [1]_.

References
----------
.. [1] A. O'Hagan and J. Forster, "Kendall's Advanced Theory of Statistics 2B: Bayesian
   Inference", 2nd ed., Arnold (2004), chapter 11.
"""

import dataclasses
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from .whitening import FilterResult, MaternProcess, gram_of_each, whitened_gram

NOISE_PRIOR = 3.0
"""[1] :math:`a_0`, with which the stated standard deviation is right to about 30 %. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class CoefficientPosterior:
    r"""Posterior of the coefficients, and the evidence of the law.

    Parameters
    ----------
    factor
        Lower Cholesky factor of its precision, for :math:`\kappa = 1`.
    log_evidence
        Up to a constant that is the same for all laws of the same readings [nats].
    """

    mean: Float[np.ndarray, " coefficient"]
    factor: Float[np.ndarray, "coefficient coefficient"]
    quadratic: float
    log_evidence: float
    count: int

    @property
    def noise_variance(self) -> float:
        r"""Posterior mean of :math:`\kappa^2` [1]."""
        shape = NOISE_PRIOR + 0.5 * self.count
        return (NOISE_PRIOR + 0.5 * self.quadratic) / (shape - 1.0)

    @property
    def covariance(self) -> Float[np.ndarray, "coefficient coefficient"]:
        r"""Covariance of the coefficients, :math:`\kappa^2` included."""
        inverse = solve_triangular(self.factor, np.eye(len(self.mean)), lower=True)
        spread: np.ndarray = self.noise_variance * (inverse.T @ inverse)
        return spread


def coefficient_posterior(
    filtered: FilterResult, prior_variance: Float[np.ndarray, " coefficient"], count: int
) -> CoefficientPosterior:
    r"""Posterior of the coefficients from whitened columns.

    The first column is the reading, the others are one regressor for each coefficient.
    """
    reading, columns = filtered.white[:, 0], filtered.white[:, 1:]
    precision = columns.T @ columns
    precision[np.diag_indices(len(precision))] += 1.0 / prior_variance
    factor = np.linalg.cholesky(precision)
    half = solve_triangular(factor, columns.T @ reading, lower=True)
    quadratic = max(float(reading @ reading - half @ half), 0.0)
    volume = 2.0 * np.log(np.diag(factor)).sum() + np.log(prior_variance).sum()
    return CoefficientPosterior(
        solve_triangular(factor, half, lower=True, trans="T"),
        factor,
        quadratic,
        _log_evidence(quadratic, float(volume) + filtered.log_determinant, count),
        count,
    )


@no_type_check
def log_evidence(
    process: MaternProcess,
    step: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
    prior_variance: Float[np.ndarray, " coefficient"],
    count: int,
) -> float:
    """Log-evidence of a law [nats], without its coefficients."""
    # Unchecked, because a search for the best process calls it thousands of times.
    gram, log_determinant = whitened_gram(process, step, variance, columns)
    inner = np.arange(len(prior_variance))
    gram[inner, inner] += 1.0 / prior_variance
    # The last diagonal entry is what the regressors leave of the reading.
    diagonal = np.diag(np.linalg.cholesky(gram))
    volume = 2.0 * np.log(diagonal[:-1]).sum() + np.log(prior_variance).sum()
    return float(_log_evidence(diagonal[-1] ** 2, volume + log_determinant, count))


def log_evidence_of_additions(
    base: FilterResult,
    base_variance: Float[np.ndarray, " coefficient"],
    white: Float[np.ndarray, "time candidate column"],
    variance: Float[np.ndarray, "candidate column"],
    count: int,
) -> Float[np.ndarray, " candidate"]:
    """Log-evidence of a law with each of many additions [nats].

    `base` is the whitened reading, then the regressors that the law has already; `white` and
    `variance` are the whitened regressors of each candidate, and prior variances of their
    coefficients.
    """
    each, width = white.shape[1:]
    reading, columns = base.white[:, 0], base.white[:, 1:]
    precision = columns.T @ columns + np.diag(1.0 / base_variance)
    factor = np.linalg.cholesky(precision)
    known = solve_triangular(factor, columns.T @ reading, lower=True)
    flat = white.reshape(len(white), -1)
    cross = solve_triangular(factor, columns.T @ flat, lower=True)
    gram = gram_of_each(white)
    shared = cross.reshape(-1, each, width)
    gram -= np.einsum("bki,bkj->kij", shared, shared)
    gram[:, np.arange(width), np.arange(width)] += 1.0 / variance
    right = (flat.T @ reading - cross.T @ known).reshape(each, width)
    solved = np.linalg.solve(gram, right[..., None])[..., 0]
    quadratic = float(reading @ reading - known @ known) - np.sum(right * solved, axis=1)
    volume = (
        base.log_determinant
        + 2.0 * np.log(np.diag(factor)).sum()
        + np.log(base_variance).sum()
        + np.linalg.slogdet(gram)[1]
        + np.log(variance).sum(axis=1)
    )
    found: Float[np.ndarray, " candidate"] = _log_evidence(
        np.maximum(quadratic, 0.0), volume, count
    )
    return found


@no_type_check
def _log_evidence(quadratic, volume, count: int):
    shape = NOISE_PRIOR + 0.5 * count
    return -0.5 * volume - shape * np.log1p(0.5 * quadratic / NOISE_PRIOR)
