"""Hybrid polynomial correlated function expansion: a homotopy trend and a Gaussian residual."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .bases import Basis, indices
from .correlated import ProcessSurrogate
from .covariances import Covariance, Expanded, Sum, covariance
from .process import Learnt

MOST_TERMS = 400
HIGHEST = 10


class HybridExpansion(ProcessSurrogate):
    r"""H-PCFE: an expansion in few inputs at a time for the trend, a process for what is left.

    .. math:: y = \sum_{\alpha} a_\alpha \psi_\alpha(x) + Z(x) + \epsilon

    There are more terms than points, so the :math:`a_\alpha` are those of least weight
    :math:`a^T W a`, as in homotopy regression. Where the published method sets :math:`W` and
    alternates between trend and residual, here degree, interaction and residual share one
    likelihood: the weights are learnt, and the uncertainty of the trend counts in the band.
    With the residual and the noise gone the coefficients are those of `homotopy.homotopy`.

    Parameters
    ----------
    degree
        Highest total degree; ``"auto"`` for as many as 400 terms allow, up to 10.
    interaction
        Most inputs in one term.
    kernel
        Covariance of the residual, as for `GaussianProcess`.
    marginals
        A frozen distribution of `scipy.stats` per input; uniform over the design if None.
    nugget
        Standard deviation of noise beside that given to `fit` [unit of y]; learnt if None.
    starts
        Of the search for the parameters.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    Attributes
    ----------
    terms_, coefficients_
        Degrees of each term of the trend [term input], and its coefficient [unit of y].
    weights_
        Of each coefficient in the homotopy, 1 / variance [1 / unit of y²].
    log_likelihood_
        Restricted likelihood of the outputs, scaled to unit variance.

    References
    ----------
    .. [1] S. Chatterjee, R. Chakraborty and S. Chakraborty; S. Chakraborty and R. Chowdhury,
       "Hybrid framework for the estimation of rare failure event probability", J. Eng. Mech.
       143 (2017) 04017010.

    Examples
    --------
    >>> x = np.random.default_rng(1).uniform(size=(30, 2))
    >>> surrogate = HybridExpansion().fit(x, x[:, 0] * x[:, 1])
    >>> surrogate.predict([[0.5, 0.5]]).round(4)
    array([0.25])
    """

    def __init__(
        self,
        degree: int | str = "auto",
        *,
        interaction: int = 2,
        kernel: str = "matern52",
        marginals: Sequence[Any] | None = None,
        nugget: float | None = None,
        starts: int = 2,
        extrapolation: str = "warn",
    ) -> None:
        self.degree = degree
        self.interaction = interaction
        self.kernel = kernel
        self.marginals = marginals
        self.nugget = nugget
        self.starts = starts
        self.extrapolation = extrapolation

    def _covariance(self) -> Covariance:
        return Sum((self._expanded(), covariance(self.kernel)))

    def _expanded(self) -> Expanded:
        self.marginals_ = self._laws(self.marginals)
        if self.degree == "auto":
            terms = _affordable(self.n_features_in_, self.interaction)
        else:
            terms = indices(self.n_features_in_, int(self.degree), interaction=self.interaction)
        # The constant is the trend on which nothing is believed beforehand.
        self.terms_ = terms[(terms > 0).any(axis=1)]
        basis = Basis(self.marginals_, self.terms_, self.domain_.lo, self._width())
        return Expanded(self.terms_, basis)

    def _report(self, process: Learnt) -> None:
        whole = process.covariance
        part = whole.parts[0] if isinstance(whole, Sum) else whole
        assert isinstance(part, Expanded)
        theta = process.theta[: len(part.ranges(self.n_features_in_))]
        variances = part.variances(theta)
        design = part.design(process.readings.x)
        self.coefficients_ = self.y_scale_ * variances * (design.T @ process.weights)
        self.constant_ = self.y_mean_ + self.y_scale_ * float(process.trend[0])
        self.weights_ = 1.0 / (variances * self.y_scale_**2)
        # Held by the process in any case; here it would double what a pickle weighs.
        if isinstance(part.design, Basis):
            part.design.last = None


def _affordable(inputs: int, interaction: int) -> np.ndarray:
    best = indices(inputs, 1)
    for degree in range(2, HIGHEST + 1):
        terms = indices(inputs, degree, interaction=interaction)
        if len(terms) > MOST_TERMS:
            break
        best = terms
    return best
