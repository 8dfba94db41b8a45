"""Generalised analysis of variance: contributions of inputs and pairs of inputs.

Inputs may be correlated. Then the share of an input has two parts: what it does itself, and
what it does by going along with others.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.special import ndtr
from scipy.stats import qmc

from slowtime.surrogate.bases import Law, PolynomialBasis, polynomials

from .covariances import Covariance
from .expansion_surrogate import ExpansionSurrogate

DRAWS = 4096


@dataclass(frozen=True, slots=True)
class VarianceShare:
    r"""Share of the variance by one component function :math:`g_u`.

    `whole` is :math:`\mathrm{Cov}(g_u, y) / \mathrm{Var}\,y`; they add up to 1. `structural`
    is :math:`\mathrm{Var}\,g_u / \mathrm{Var}\,y`, `correlated` the rest, which vanishes where
    inputs are independent and may be negative.
    """

    inputs: tuple[int, ...]
    whole: float
    structural: float
    correlated: float


class GeneralisedAnova(ExpansionSurrogate):
    r"""HDMR :math:`g_0 + \sum g_i + \sum g_{ij}` with inputs that may be correlated.

    Coefficients are those of homotopy regression on orthonormal polynomials in one and two
    inputs, its weights learnt by likelihood. Component functions are made orthogonal by
    hierarchy under the joint law: :math:`g_{ij}` to every function of :math:`x_i` or
    :math:`x_j` alone, but not :math:`g_i` to :math:`g_j`.

    Parameters
    ----------
    degree
        Highest total degree; ``"auto"`` for as many as 400 terms allow, up to 10.
    interaction
        1 or 2 inputs in one term.
    marginals
        A frozen distribution of `scipy.stats` per input; as in the design if None.
    nugget
        Standard deviation of noise beside that given to `fit` [unit of y]; learnt if None.
    starts
        Of the search for the parameters.
    folds
        Parts of the design, each left out once and foretold by a process learnt from the
        others; the band is widened by what their errors ask for. 1 takes the likelihood's word.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    References
    ----------
    .. [1] S. Chakraborty and R. Chowdhury, "Polynomial correlated function expansion for
       nonlinear stochastic dynamic analysis", J. Eng. Mech. 141 (2015) 04014132.
    .. [2] G. Li and H. Rabitz, "General formulation of HDMR component functions with
       independent and correlated variables", J. Math. Chem. 50 (2012) 99-130.

    Examples
    --------
    >>> x = np.random.default_rng(0).uniform(size=(40, 2))
    >>> surrogate = GeneralisedAnova().fit(x, 3.0 * x[:, 0] + x[:, 1])
    >>> [(share.inputs, round(share.whole, 1)) for share in surrogate.shares()][:2]
    [((0,), 0.9), ((1,), 0.1)]
    """

    def __init__(
        self,
        degree: int | str = "auto",
        *,
        interaction: int = 2,
        marginals: Sequence[Any] | None = None,
        nugget: float | None = None,
        starts: int = 4,
        folds: int = 5,
        extrapolation: str = "warn",
    ) -> None:
        self.degree = degree
        self.interaction = interaction
        self.marginals = marginals
        self.nugget = nugget
        self.starts = starts
        self.folds = folds
        self.extrapolation = extrapolation

    def shares(self, sample: Any = None) -> list[VarianceShare]:
        """Shares of the variance by component, the largest first.

        Parameters
        ----------
        sample
            Draws of the joint law of the inputs [draw input]; if None, a Gaussian copula with
            the rank correlations of the design and its marginals.

        Returns
        -------
        Share of each component [1].
        """
        if sample is None:
            sample = joint(self._design(), self.marginals)
        parts = self.components(sample)
        whole = np.sum([part for which, part in parts.items() if which], axis=0)
        variance = float(np.var(whole))
        found = []
        for which, part in parts.items():
            if which:
                total = float(np.mean((part - part.mean()) * (whole - whole.mean())))
                own = float(np.var(part))
                found.append(
                    VarianceShare(
                        which, total / variance, own / variance, (total - own) / variance
                    )
                )
        return sorted(found, key=lambda share: -share.whole)

    def components(self, sample: Any) -> dict[tuple[int, ...], np.ndarray]:
        """Component functions at draws of the joint law, orthogonal by hierarchy under it."""
        x = np.asarray(sample, dtype=float)
        parts = self._raw(x)
        degree = int(self.terms_.max())
        for pair in [which for which in parts if len(which) == 2]:
            alone = [polynomials(x[:, d], self.marginals_[d], degree)[:, 1:] for d in pair]
            columns = np.column_stack([np.ones(len(x)), *alone])
            found, *_ = np.linalg.lstsq(columns, parts[pair], rcond=1e-10)
            parts[pair] = parts[pair] - columns @ found
            parts[()] = parts[()] + found[0]
            for k, d in enumerate(pair):
                its = alone[k] @ found[1 + k * degree : 1 + (k + 1) * degree]
                parts[(d,)] = parts[(d,)] + its
        for which in [which for which in parts if len(which) == 1]:
            mean = parts[which].mean()
            parts[which] = parts[which] - mean
            parts[()] = parts[()] + mean
        return parts

    def _raw(self, x: np.ndarray) -> dict[tuple[int, ...], np.ndarray]:
        basis = PolynomialBasis(
            self.marginals_, self.terms_, np.zeros(x.shape[1]), np.ones(x.shape[1])
        )
        values = basis(x) * self.coefficients_
        parts: dict[tuple[int, ...], np.ndarray] = {(): np.full(len(x), self.constant_)}
        inputs = range(x.shape[1])
        for size in range(1, self.interaction + 1):
            for which in itertools.combinations(inputs, size):
                used = self.terms_ > 0
                mine = used[:, list(which)].all(axis=1) & (used.sum(axis=1) == size)
                parts[which] = values[:, mine].sum(axis=1)
        return parts

    def _covariance(self) -> Covariance:
        if self.interaction not in (1, 2):
            raise ValueError(
                f"interaction={self.interaction} has no decomposition by hierarchy here. Give "
                "1 or 2; for more, use PolynomialChaos."
            )
        return self._expanded()

    def _design(self) -> np.ndarray:
        return np.asarray(self.domain_.lo + self._width() * self.process_.readings.x)


def joint(
    design: Float[np.ndarray, "sample input"],
    marginals: Sequence[Law] | None = None,
    draws: int = DRAWS,
) -> Float[np.ndarray, "draw input"]:
    """Quasi-random draws of a Gaussian copula with the rank correlations of a design.

    Parameters
    ----------
    design
        Points, each input in its own unit.
    marginals
        Distribution of each input; by default the quantiles of the design.
    draws
        Number of draws.

    Returns
    -------
    Draws, each input in its own unit.
    """
    inputs = design.shape[1]
    rank = np.atleast_2d(np.corrcoef(stats.rankdata(design, axis=0), rowvar=False))
    values, vectors = np.linalg.eigh(2.0 * np.sin(np.pi / 6.0 * rank))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    even = qmc.Halton(inputs, scramble=False).random(draws + 1)[1:]
    normal = stats.norm.ppf(even) @ root.T
    probability = ndtr(normal / np.sqrt(np.sum(root**2, axis=1)))
    columns = [
        np.quantile(design[:, d], probability[:, d])
        if marginals is None
        else marginals[d].ppf(probability[:, d])
        for d in range(inputs)
    ]
    return np.stack(columns, axis=1)
