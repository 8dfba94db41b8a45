"""Hybrid polynomial correlated function expansion (H-PCFE)."""

from collections.abc import Sequence
from typing import Any

from .covariances import Covariance, SumCovariance, covariance
from .expansion_surrogate import ExpansionSurrogate


class HybridExpansion(ExpansionSurrogate):
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
    folds
        Parts of the design, each left out once and foretold by a process learnt from the
        others; the band is widened by what their errors ask for. 1 takes the likelihood's word.
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
    inflation_
        By what the standard deviation of the process is multiplied, 1 or more; see `folds`.

    References
    ----------
    .. [1] S. Chakraborty and R. Chowdhury, "An efficient algorithm for building locally refined
       hp-adaptive H-PCFE: application to uncertainty quantification", J. Comput. Phys. 351
       (2017) 59-79.

    Examples
    --------
    >>> import numpy as np
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
        kernel: str = "squared exponential",
        marginals: Sequence[Any] | None = None,
        nugget: float | None = None,
        starts: int = 4,
        folds: int = 5,
        extrapolation: str = "warn",
    ) -> None:
        self.degree = degree
        self.interaction = interaction
        self.kernel = kernel
        self.marginals = marginals
        self.nugget = nugget
        self.starts = starts
        self.folds = folds
        self.extrapolation = extrapolation

    def _covariance(self) -> Covariance:
        return SumCovariance((self._expanded(), covariance(self.kernel)))
