"""Terms of a law, its design matrix, and its coefficients given a screened history."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from slowtime.history_diagnosis.data.history import FilledCovariate, ScaledHistory, Series
from slowtime.history_diagnosis.likelihood import evidence
from slowtime.history_diagnosis.likelihood.evidence import CoefficientPosterior
from slowtime.history_diagnosis.likelihood.whitening import FilterResult, MaternProcess, whiten

from .catalogue import HistoryLaw, Shape

_CONSTANT_SD = 10.0
"""[scatters of the readings] Prior standard deviation of the constant: wide, as the values have
zero median. Source: docs/what_decides.md: half and double change no answer."""
_LEAST_COLUMN_VARIANCE = 0.01
"""[1] Variance of a regressor below which the prior of its coefficient stops widening. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A candidate law with values of its shape parameters."""

    law: HistoryLaw
    shape: Shape

    def columns(self, time: Series, covariates: tuple[FilledCovariate, ...]) -> np.ndarray:
        """Return the regressors at epochs, shape (time, coefficient)."""
        drawn: np.ndarray = self.law.columns(time, covariates, self.shape)
        return drawn


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ScreenedHistory:
    """A scaled history, its outliers, and the variance of its noise.

    Parameters
    ----------
    variance
        Of the noise of each reading as stated, and of interpolated covariates [scale²].
    barred
        Readings known to be wrong, which are never used again.
    """

    past: ScaledHistory
    mask: Bool[np.ndarray, " time"]
    variance: Series
    barred: Bool[np.ndarray, " time"]

    @property
    def count(self) -> int:
        """Number of readings used."""
        return int(self.mask.sum())


def design(
    terms: tuple[Term, ...], time: Series, covariates: tuple[FilledCovariate, ...]
) -> Float[np.ndarray, "time coefficient"]:
    """Return the design matrix: a constant, then the regressors of all terms."""
    columns: Float[np.ndarray, "time coefficient"] = np.column_stack(
        [np.ones(len(time)), *(t.columns(time, covariates) for t in terms)]
    )
    return columns


def column_priors(
    columns: Float[np.ndarray, "time column"], mask: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " column"]:
    """Return prior variances with which each column may explain the scatter of the readings."""
    variance = np.var(columns[mask], axis=0)
    widths: Float[np.ndarray, " column"] = 1.0 / np.maximum(variance, _LEAST_COLUMN_VARIANCE)
    return widths


def design_priors(
    columns: Float[np.ndarray, "time coefficient"], mask: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " coefficient"]:
    """Return prior variances of the coefficients of a design matrix, constant first."""
    variance = column_priors(columns, mask)
    variance[0] = _CONSTANT_SD**2
    return variance


def solve(
    readings: ScreenedHistory, terms: tuple[Term, ...], process: MaternProcess
) -> tuple[CoefficientPosterior, FilterResult]:
    """Return the posterior of the coefficients, and the whitened reading and regressors."""
    past = readings.past
    columns = design(terms, past.time, past.covariates)
    stacked = np.column_stack([past.value, columns])
    filtered = whiten(process, past.time, noise_variance(readings, terms), stacked)
    priors = design_priors(columns, readings.mask)
    return evidence.coefficient_posterior(filtered, priors, readings.count), filtered


def stated_variance(readings: ScreenedHistory, terms: tuple[Term, ...]) -> Series:
    """Return the variance of the noise, changed by terms of the noise [scale²]."""
    variance = readings.variance
    for term in terms:
        variance = variance * term.law.variance_factor(readings.past.time, term.shape)
    return variance


def noise_variance(readings: ScreenedHistory, terms: tuple[Term, ...]) -> Series:
    """Return the same, infinite for readings that are not used."""
    return np.where(readings.mask, stated_variance(readings, terms), np.inf)


def gap_variance(
    terms: tuple[Term, ...],
    time: Series,
    covariates: tuple[FilledCovariate, ...],
    mean: Float[np.ndarray, " coefficient"],
) -> Series:
    """Return the variance that interpolated covariates add to the readings [scale²]."""
    columns = design(terms, time, covariates)
    total = np.zeros(len(time))
    for index, covariate in enumerate(covariates):
        if covariate.sd.any():
            nudged = list(covariates)
            values = covariate.values + covariate.sd
            nudged[index] = dataclasses.replace(covariate, values=values)
            total = total + ((design(terms, time, tuple(nudged)) - columns) @ mean) ** 2
    return total
