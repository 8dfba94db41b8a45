"""Base of surrogates with a homotopy expansion in a few inputs at a time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from slowtime.surrogate.bases import PolynomialBasis, indices

from .covariances import Expanded, SumCovariance
from .process_surrogate import ProcessSurrogate
from .regression import TrainedProcess

MOST_TERMS = 400
HIGHEST = 10


class ExpansionSurrogate(ProcessSurrogate):
    """An expansion whose coefficients are of least weight, the weights learnt by likelihood."""

    degree: int | str
    interaction: int
    marginals: Sequence[Any] | None

    def _expanded(self) -> Expanded:
        self.marginals_ = self._laws(self.marginals)
        if self.degree == "auto":
            terms = _affordable(self.n_features_in_, self.interaction)
        else:
            terms = indices(self.n_features_in_, int(self.degree), interaction=self.interaction)
        # The constant is the trend on which nothing is believed beforehand.
        self.terms_ = terms[(terms > 0).any(axis=1)]
        basis = PolynomialBasis(self.marginals_, self.terms_, self.domain_.lo, self._width())
        return Expanded(self.terms_, basis)

    def _report(self, process: TrainedProcess) -> None:
        whole = process.covariance
        part = whole.parts[0] if isinstance(whole, SumCovariance) else whole
        assert isinstance(part, Expanded)
        theta = process.theta[: len(part.ranges(self.n_features_in_))]
        variances = part.variances(theta)
        design = part.design(process.readings.x)
        self.coefficients_ = self.y_scale_ * variances * (design.T @ process.weights)
        self.constant_ = self.y_mean_ + self.y_scale_ * float(process.trend[0])
        self.weights_ = 1.0 / (variances * self.y_scale_**2)
        # Held by the process in any case; here it would double what a pickle weighs.
        if isinstance(part.design, PolynomialBasis):
            part.design.last = None


def _affordable(inputs: int, interaction: int) -> np.ndarray:
    best = indices(inputs, 1)
    for degree in range(2, HIGHEST + 1):
        terms = indices(inputs, degree, interaction=interaction)
        if len(terms) > MOST_TERMS:
            break
        best = terms
    return best
