"""Sparse polynomial chaos expansions and their Sobol indices."""

import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy import stats
from scipy.linalg import solve_triangular

from .bases import MOST_TERMS, indices, products
from .interface import Surrogate
from .least_squares import Expansion, all_of, nested
from .surrogate_warnings import IllConditionedWarning, NothingLearntWarning

METHODS = ("lars", "least squares")
NORMS = (0.5, 0.75, 1.0)
WORST_CONDITION = 1e6
PATIENCE = 2
"""Degrees in a row that must foretell no better before higher ones are given up."""


class PolynomialChaos(Surrogate):
    r"""Expansion :math:`y = \sum_\alpha c_\alpha \psi_\alpha(x)` in orthonormal polynomials.

    Parameters
    ----------
    degree
        Highest total degree; ``"auto"`` raises it while the corrected leave-one-out error
        falls, at most to `most_degree`.
    most_degree
        Of the search.
    method
        ``"lars"`` ranks terms by least-angle regression and keeps as many as foretell best;
        ``"least squares"`` keeps all terms of a degree.
    q_norm
        Hyperbolic truncation in (0, 1]; ``"auto"`` tries 0.5, 0.75 and 1.
    interaction
        Most inputs in one term; no limit if None.
    marginals
        A frozen distribution of `scipy.stats` per input, independent of each other; uniform
        over the box of the design if None. Mean, variance and indices are under these.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    Attributes
    ----------
    terms_, coefficients_
        Degrees of each term kept [term input], and its coefficient [unit of y].
    mean_, variance_
        Of the output under the marginals.
    sobol_first_, sobol_total_
        Share of the variance by each input alone, and with all its interactions.
    loo_
        Corrected leave-one-out error over the variance of the outputs.

    References
    ----------
    .. [1] G. Blatman and B. Sudret, "Adaptive sparse polynomial chaos expansion based on least
       angle regression", J. Comput. Phys. 230 (2011) 2345-2367.
    .. [2] B. Sudret, "Global sensitivity analysis using polynomial chaos expansions", Reliab.
       Eng. Syst. Saf. 93 (2008) 964-979.

    Examples
    --------
    >>> x = np.linspace(-1.0, 1.0, 20)[:, None]
    >>> surrogate = PolynomialChaos().fit(x, 1.0 + x[:, 0] ** 2)
    >>> surrogate.predict([[0.5]]).round(6)
    array([1.25])
    """

    def __init__(
        self,
        degree: int | str = "auto",
        *,
        most_degree: int = 12,
        method: str = "lars",
        q_norm: float | str = "auto",
        interaction: int | None = None,
        marginals: Sequence[Any] | None = None,
        extrapolation: str = "warn",
    ) -> None:
        self.degree = degree
        self.most_degree = most_degree
        self.method = method
        self.q_norm = q_norm
        self.interaction = interaction
        self.marginals = marginals
        self.extrapolation = extrapolation

    def sobol(self, *inputs: int) -> float:
        """Share of the variance by just these inputs together, none left out and none added."""
        other = np.delete(self.terms_, inputs, axis=1)
        just = (self.terms_[:, list(inputs)] > 0).all(axis=1) & (other == 0).all(axis=1)
        return float(np.sum(self.coefficients_[just] ** 2) / (self.variance_ or np.inf))

    def _learn(self, x: np.ndarray, y: np.ndarray) -> None:
        if self.method not in METHODS:
            raise ValueError(
                f"method={self.method!r} is not known. Allowed: {', '.join(METHODS)}."
            )
        self.marginals_ = self._laws(self.marginals)
        best: tuple[np.ndarray, Expansion] | None = None
        for q_norm in NORMS if self.q_norm == "auto" else [float(self.q_norm)]:
            for terms, found in self._raised(x, y, q_norm):
                if best is None or found.loo < best[1].loo:
                    best = terms, found
        if best is None or not np.isfinite(best[1].loo):
            raise ValueError(
                f"{len(y)} points do not suffice for an expansion by method="
                f"{self.method!r} of degree={self.degree!r} in {x.shape[1]} inputs. Give more "
                "points, a lower degree, or method='lars'."
            )
        self._keep(*best)
        if best[1].condition > WORST_CONDITION:
            warnings.warn(
                f"The condition number of the design is {best[1].condition:.0e}. Give points "
                "spread evenly over the marginals, or a lower degree.",
                IllConditionedWarning,
                stacklevel=3,
            )

    def _raised(
        self, x: np.ndarray, y: np.ndarray, q_norm: float
    ) -> Iterator[tuple[np.ndarray, Expansion]]:
        """Expansions of rising degree, until it no longer pays."""
        if self.degree == "auto":
            degrees = range(1, self.most_degree + 1)
        else:
            degrees = range(int(self.degree), int(self.degree) + 1)
        least, worse, before = np.inf, 0, 0
        for degree in degrees:
            terms = indices(x.shape[1], degree, interaction=self.interaction, q_norm=q_norm)
            if self.degree == "auto" and degree > 1 and not self._affordable(terms, len(y)):
                return
            if len(terms) == before:
                continue
            before = len(terms)
            design = products(x, self.marginals_, terms)
            if self.method == "lars":
                found = nested(design, y, _ranked(design, y))
            else:
                found = all_of(design, y)
            yield terms, found
            worse = 0 if found.loo < least else worse + 1
            least = min(least, found.loo)
            if worse >= PATIENCE:
                return

    def _affordable(self, terms: np.ndarray, points: int) -> bool:
        most = min(MOST_TERMS, 10 * points) if self.method == "lars" else points - 1
        return len(terms) <= most

    def _keep(self, terms: np.ndarray, found: Expansion) -> None:
        self.terms_ = terms[found.terms]
        self.coefficients_ = self.y_scale_ * found.coefficients
        self.triangle_ = found.triangle
        self.loo_ = found.loo
        constant = (self.terms_ == 0).all(axis=1)
        self.mean_ = self.y_mean_ + float(self.coefficients_[constant].sum())
        square = np.where(constant, 0.0, self.coefficients_**2)
        self.variance_ = float(square.sum())
        if self.variance_ == 0.0:
            warnings.warn(
                "No term foretells better than the mean does, so the mean it is. Give more "
                "points, other inputs, or a higher degree.",
                NothingLearntWarning,
                stacklevel=4,
            )
        used = self.terms_ > 0
        alone = used & (used.sum(axis=1) == 1)[:, None]
        whole = self.variance_ or np.inf
        self.sobol_first_ = square @ alone / whole
        self.sobol_total_ = square @ used / whole

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        design = products(x, self.marginals_, self.terms_)
        mean = design @ self.coefficients_ / self.y_scale_
        # What is left out of an expansion errs everywhere alike; its coefficients by leverage.
        leverage = np.sum(solve_triangular(self.triangle_, design.T, trans="T") ** 2, axis=0)
        points = self._points()
        return mean, np.sqrt(self.loo_ * (1.0 + leverage) / (1.0 + len(self.terms_) / points))

    def _points(self) -> int:
        return round(2.0 / self.domain_.margin) - 1

    def _quantile(self, level: float) -> float:
        freedom = max(self._points() - len(self.terms_), 1)
        return float(stats.t.ppf(0.5 + 0.5 * level, freedom))


def _ranked(design: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Columns in the order in which least-angle regression takes them, the constant first."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import lars_path

    columns = design[:, 1:] - design[:, 1:].mean(axis=0)
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 1e-12, size, np.inf)
    with warnings.catch_warnings():
        # Of columns that are alike it drops one and says so; `nested` leaves it out as well.
        warnings.simplefilter("ignore", ConvergenceWarning)
        _, active, _ = lars_path(columns, y - y.mean(), method="lar", max_iter=len(y) - 1)
    return np.concatenate([[0], np.asarray(active, dtype=int) + 1])
