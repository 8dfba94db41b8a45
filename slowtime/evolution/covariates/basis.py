r"""Basis functions of the dependence of a frequency on covariates.

Whatever the law, it is

.. math:: \ln f = \bar y + \sum_p \phi_p(c) \, \beta_p, \qquad \beta_p \sim N(0, 1)

so that one recursion learns, removes and judges all of them: linear; bilinear, with another
slope above a temperature near freezing; or, besides linear, a Gaussian process for each
covariate (Matérn 5/2) by the eigenfunctions of the Laplacian on an interval that reaches
beyond the covariates seen.

References
----------
.. [1] A. Solin, S. Särkkä, "Hilbert space methods for reduced-rank Gaussian process
   regression", Statistics and Computing 30 (2020).
.. [2] B. Peeters, G. De Roeck, "One-year monitoring of the Z24-Bridge: environmental effects
   versus damage events", Earthquake Engineering and Structural Dynamics 30 (2001): bilinear
   about freezing.
"""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

Law = Literal["constant", "linear", "bilinear", "Gaussian process"]

EIGENFUNCTIONS = 24
"""Number of eigenfunctions of a Gaussian process of one covariate."""

_REACH = 2.0  # half-width of the interval over half the range of the covariate
_MARGIN = 0.1  # of the range, by which covariates may go beyond it and still be judged


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Basis:
    """A law, with what of it is not linear in the coefficients.

    Parameters
    ----------
    law
        Which one.
    low, high
        Least and greatest of each covariate in training.
    spread
        Prior standard deviation of ln f over half the range of a covariate.
    hinge, bend
        Column of the temperature, and the temperature at which the slope changes.
    length, sd
        Of the Gaussian process: length scale over half the range, and standard deviation of
        ln f.
    """

    law: Law
    low: Float[np.ndarray, " covariate"]
    high: Float[np.ndarray, " covariate"]
    spread: float
    hinge: int = 0
    bend: float = 0.0
    length: float = 1.0
    sd: float = 0.0

    def features(
        self, covariates: Float[np.ndarray, "time covariate"]
    ) -> Float[np.ndarray, "time coefficient"]:
        """Basis functions at covariates, for coefficients of unit prior variance.

        Parameters
        ----------
        covariates
            Temperature and loads, one column each.

        Returns
        -------
        One row per reading.
        """
        count = len(covariates)
        columns = [np.full((count, 1), 10.0 * self.spread)]
        if self.law == "constant":
            return columns[0]
        half = self._half
        scaled = (covariates - 0.5 * (self.low + self.high)) / half
        columns.append(self.spread * scaled)
        if self.law == "bilinear":
            above = np.maximum(covariates[:, self.hinge] - self.bend, 0.0)
            columns.append(self.spread * above[:, None] / half[self.hinge])
        if self.law == "Gaussian process":
            inside = np.clip(scaled, -_REACH, _REACH)
            columns += [self._waves(column) for column in inside.T]
        return np.concatenate(columns, axis=1)

    def within(
        self, covariates: Float[np.ndarray, "time covariate"]
    ) -> Bool[np.ndarray, " time"]:
        """Whether covariates lie within the range of the training, with a small margin.

        Parameters
        ----------
        covariates
            Temperature and loads, one column each.

        Returns
        -------
        Flag of each reading.
        """
        if self.law == "constant":
            return np.ones(len(covariates), dtype=bool)
        margin = 2.0 * _MARGIN * self._half
        inside = (covariates >= self.low - margin) & (covariates <= self.high + margin)
        return np.asarray(inside.all(axis=1))

    @property
    def _half(self) -> Float[np.ndarray, " covariate"]:
        half = 0.5 * (self.high - self.low)
        return np.where(half > 0.0, half, 1.0)

    def _waves(self, scaled: Float[np.ndarray, " time"]) -> np.ndarray:
        """Eigenfunctions times the root of the spectral density of the process at each."""
        frequency = np.pi * np.arange(1, EIGENFUNCTIONS + 1) / (2.0 * _REACH)
        rate = np.sqrt(5.0) / self.length
        density = self.sd**2 * (16.0 / 3.0) * rate**5 / (rate**2 + frequency**2) ** 3
        waves = np.sin(np.outer(scaled + _REACH, frequency)) / np.sqrt(_REACH)
        return np.asarray(waves * np.sqrt(density))
