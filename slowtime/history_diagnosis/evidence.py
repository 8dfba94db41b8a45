r"""How probable readings are under a law, with everything linear integrated out.

.. math:: y \sim N(X \beta, \kappa^2 V), \quad \beta \sim N(0, \kappa^2 P), \quad
          1 / \kappa^2 \sim \Gamma(a_0, a_0)

where V is the covariance of wandering and noise as stated. The factor :math:`\kappa` forgives
stated standard deviations that are wrong as a whole; P is as wide as the scatter of the
readings, so that a term that is not needed costs what it could have explained (O'Hagan and
Forster, "Kendall's Advanced Theory of Statistics 2B", 2004, chapter 11).
"""

import dataclasses
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from .whitening import Filtered, blocks

NOISE_PRIOR = 3.0  # a_0: the stated sd is right to about 30 %
MEAN_SD = 10.0  # prior sd of the constant, in units of the scatter


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Coefficients given the readings, and how probable these were.

    Parameters
    ----------
    mean, factor
        Of the coefficients: mean, and lower factor of the precision (in units of the noise).
    quadratic
        Sum of squares that is left, prior included, in units of the stated noise.
    log_evidence
        Up to a constant that is the same for all laws of the same readings.
    count
        Of readings used.
    """

    mean: Float[np.ndarray, " coefficient"]
    factor: Float[np.ndarray, "coefficient coefficient"]
    quadratic: float
    log_evidence: float
    count: int

    @property
    def noise_variance(self) -> float:
        r"""Posterior mean of :math:`\kappa^2`."""
        shape = NOISE_PRIOR + 0.5 * self.count
        return (NOISE_PRIOR + 0.5 * self.quadratic) / (shape - 1.0)

    @property
    def covariance(self) -> Float[np.ndarray, "coefficient coefficient"]:
        """Of the coefficients, the factor of the noise included."""
        inverse = solve_triangular(self.factor, np.eye(len(self.mean)), lower=True)
        spread: np.ndarray = self.noise_variance * (inverse.T @ inverse)
        return spread


def posterior(
    filtered: Filtered, prior_variance: Float[np.ndarray, " coefficient"], count: int
) -> Posterior:
    """Integrate out coefficients; the first filtered column is the reading."""
    reading, columns = filtered.white[:, 0], filtered.white[:, 1:]
    precision = columns.T @ columns
    precision[np.diag_indices(len(precision))] += 1.0 / prior_variance
    factor = np.linalg.cholesky(precision)
    half = solve_triangular(factor, columns.T @ reading, lower=True)
    quadratic = max(float(reading @ reading - half @ half), 0.0)
    volume = 2.0 * np.log(np.diag(factor)).sum() + np.log(prior_variance).sum()
    return Posterior(
        solve_triangular(factor, half, lower=True, trans="T"),
        factor,
        quadratic,
        _log_evidence(quadratic, float(volume) + filtered.log_determinant, count),
        count,
    )


@no_type_check
def of_gram(
    gram: Float[np.ndarray, "column column"],
    log_determinant: float,
    prior_variance: Float[np.ndarray, " coefficient"],
    count: int,
) -> float:
    """Log-evidence from products of whitened columns, of which the last is the reading."""
    whole = gram.copy()
    inner = np.arange(len(prior_variance))
    whole[inner, inner] += 1.0 / prior_variance
    # The factor of all columns ends in what the others leave of the reading.
    diagonal = np.diag(np.linalg.cholesky(whole))
    volume = 2.0 * np.log(diagonal[:-1]).sum() + np.log(prior_variance).sum()
    return float(_log_evidence(diagonal[-1] ** 2, volume + log_determinant, count))


def many(
    base: Filtered,
    base_variance: Float[np.ndarray, " coefficient"],
    white: Float[np.ndarray, "time candidate column"],
    variance: Float[np.ndarray, "candidate column"],
    count: int,
) -> Float[np.ndarray, " candidate"]:
    """Log-evidence of a law with each of many additions.

    Parameters
    ----------
    base
        Filtered readings, then columns of what the law has already.
    base_variance
        Prior variances of their coefficients.
    white, variance
        Filtered columns of each candidate, and prior variances of theirs.
    count
        Of readings used.
    """
    each, width = white.shape[1:]
    reading, columns = base.white[:, 0], base.white[:, 1:]
    precision = columns.T @ columns + np.diag(1.0 / base_variance)
    factor = np.linalg.cholesky(precision)
    known = solve_triangular(factor, columns.T @ reading, lower=True)
    flat = white.reshape(len(white), -1)
    cross = solve_triangular(factor, columns.T @ flat, lower=True)
    gram = blocks(white)
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
