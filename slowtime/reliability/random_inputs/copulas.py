r"""Copulas: maps from independent normal :math:`u` to dependent scores :math:`z`.

Each copula is a Rosenblatt transformation: the score of an input is drawn from its distribution
given those before it. With `GaussianCopula` that is the Nataf transformation.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import scipy
from jaxtyping import Float
from scipy import optimize, special

from .marginals import Marginal

Scores = Float[np.ndarray, "sample input"]
NODES = 40
BISECTIONS = 60
REACH = 12.0
"""Largest score that an inversion looks for."""


@runtime_checkable
class Copula(Protocol):
    """Dependence of a group of inputs."""

    def scores(self, u: Scores) -> Scores:
        """Transform independent standard normal scores to dependent ones.

        Parameters
        ----------
        u
            Independent standard normal scores.

        Returns
        -------
        Dependent standard normal scores.
        """

    def independent(self, z: Scores) -> Scores:
        """Transform dependent standard normal scores to independent ones.

        Parameters
        ----------
        z
            Dependent standard normal scores.

        Returns
        -------
        Independent standard normal scores.
        """


def _cholesky(matrix: np.ndarray) -> np.ndarray:
    if not np.allclose(matrix, matrix.T) or not np.allclose(np.diag(matrix), 1.0):
        raise ValueError("A correlation matrix is symmetric with ones on its diagonal.")
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        raise ValueError(
            f"The correlation matrix of the normal scores is not positive definite (smallest "
            f"eigenvalue {least:.2g}), so no such inputs exist. Lower the correlations."
        ) from None


@dataclasses.dataclass(frozen=True)
class GaussianCopula:
    """Normal scores with a correlation matrix."""

    correlation: Float[np.ndarray, "input input"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "_factor", _cholesky(np.asarray(self.correlation, float)))

    def scores(self, u: Scores) -> Scores:
        """Transform independent scores to dependent ones, by the Cholesky factor."""
        return np.asarray(u @ self._factor.T)  # type: ignore[attr-defined]

    def independent(self, z: Scores) -> Scores:
        """Transform dependent scores to independent ones, by the Cholesky factor."""
        return np.asarray(np.linalg.solve(self._factor, z.T).T)  # type: ignore[attr-defined]


@dataclasses.dataclass(frozen=True)
class StudentCopula:
    """Copula of a multivariate t distribution: joint extremes even without correlation."""

    correlation: Float[np.ndarray, "input input"]
    freedom: float

    def __post_init__(self) -> None:
        if self.freedom <= 0.0:
            raise ValueError(f"freedom={self.freedom:g} is not positive. Give one such as 4.")
        object.__setattr__(self, "_factor", _cholesky(np.asarray(self.correlation, float)))

    def scores(self, u: Scores) -> Scores:
        """Transform independent scores to dependent ones, by conditional t distributions."""
        y, square = np.empty_like(u), np.zeros(len(u))
        for k in range(u.shape[1]):
            freedom = self.freedom + k
            y[:, k] = _student(u[:, k], freedom) * np.sqrt((self.freedom + square) / freedom)
            square = square + y[:, k] ** 2
        return _normal(y @ self._factor.T, self.freedom)  # type: ignore[attr-defined]

    def independent(self, z: Scores) -> Scores:
        """Transform dependent scores to independent ones, by conditional t distributions."""
        y = np.linalg.solve(self._factor, _student(z, self.freedom).T).T  # type: ignore[attr-defined]
        u, square = np.empty_like(z), np.zeros(len(z))
        for k in range(z.shape[1]):
            freedom = self.freedom + k
            u[:, k] = _normal(y[:, k] * np.sqrt(freedom / (self.freedom + square)), freedom)
            square = square + y[:, k] ** 2
        return u


def _student(z: np.ndarray, freedom: float) -> np.ndarray:
    return np.asarray(-np.sign(z) * special.stdtrit(freedom, special.ndtr(-np.abs(z))))


def _normal(t: np.ndarray, freedom: float) -> np.ndarray:
    return np.asarray(-np.sign(t) * special.ndtri(special.stdtr(freedom, -np.abs(t))))


@dataclasses.dataclass(frozen=True)
class ClaytonCopula:
    """Small values go together; any number of inputs, `theta` > 0."""

    theta: float

    def __post_init__(self) -> None:
        _above(self.theta, 0.0, "ClaytonCopula")

    def scores(self, u: Scores) -> Scores:
        """Transform independent scores to dependent ones, by inverse conditional laws."""
        p, total = np.empty_like(u), np.ones(len(u))
        for k in range(u.shape[1]):
            q = _inside(special.ndtr(u[:, k]))
            power = q ** (-self.theta / (1.0 + k * self.theta))
            p[:, k] = (1.0 + total * (power - 1.0)) ** (-1.0 / self.theta)
            total = total + p[:, k] ** -self.theta - 1.0
        return np.asarray(special.ndtri(_inside(p)))

    def independent(self, z: Scores) -> Scores:
        """Transform dependent scores to independent ones, by conditional laws."""
        p, total, u = _inside(special.ndtr(z)), np.ones(len(z)), np.empty_like(z)
        for k in range(z.shape[1]):
            power = 1.0 + (p[:, k] ** -self.theta - 1.0) / total
            u[:, k] = special.ndtri(_inside(power ** (-(1.0 + k * self.theta) / self.theta)))
            total = total + p[:, k] ** -self.theta - 1.0
        return u


@dataclasses.dataclass(frozen=True)
class FrankCopula:
    """Dependence alike in both tails, of two inputs; `theta` is not 0."""

    theta: float

    def __post_init__(self) -> None:
        if self.theta == 0.0:
            raise ValueError("theta=0 of FrankCopula is independence. Leave the copula out.")

    def scores(self, u: Scores) -> Scores:
        """Transform independent scores to dependent ones, by the inverse conditional law."""
        return _second_inverted(u, self._conditional)

    def independent(self, z: Scores) -> Scores:
        """Transform dependent scores to independent ones, by the conditional law."""
        return _second(z, self._conditional)

    def _conditional(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        a, b = np.expm1(-self.theta * p), np.expm1(-self.theta * q)
        return np.asarray((a + 1.0) * b / (np.expm1(-self.theta) + a * b))


@dataclasses.dataclass(frozen=True)
class GumbelCopula:
    """Large values of two inputs go together; `theta` > 1."""

    theta: float

    def __post_init__(self) -> None:
        _above(self.theta, 1.0, "GumbelCopula")

    def scores(self, u: Scores) -> Scores:
        """Transform independent scores to dependent ones, by the inverse conditional law."""
        return _second_inverted(u, self._conditional)

    def independent(self, z: Scores) -> Scores:
        """Transform dependent scores to independent ones, by the conditional law."""
        return _second(z, self._conditional)

    def _conditional(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        x, y = -np.log(p), -np.log(q)
        total = x**self.theta + y**self.theta
        root = total ** (1.0 / self.theta)
        return np.asarray(np.exp(x - root) * (x / root) ** (self.theta - 1.0))


Conditional = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _second(z: np.ndarray, conditional: Conditional) -> np.ndarray:
    p, q = _inside(special.ndtr(z[:, 0])), _inside(special.ndtr(z[:, 1]))
    return np.stack([z[:, 0], special.ndtri(_inside(conditional(p, q)))], axis=1)


def _second_inverted(u: np.ndarray, conditional: Conditional) -> np.ndarray:
    if u.shape[1] != 2:
        raise ValueError(f"This copula joins two inputs, not {u.shape[1]}.")
    p, wanted = _inside(special.ndtr(u[:, 0])), special.ndtr(u[:, 1])
    lo, hi = np.full(len(u), -REACH), np.full(len(u), REACH)
    for _ in range(BISECTIONS):
        middle = 0.5 * (lo + hi)
        below = conditional(p, _inside(special.ndtr(middle))) < wanted
        lo, hi = np.where(below, middle, lo), np.where(below, hi, middle)
    return np.stack([u[:, 0], 0.5 * (lo + hi)], axis=1)


def _inside(p: np.ndarray) -> np.ndarray:
    return np.asarray(np.clip(p, 1e-300, 1.0 - 1e-16))


def _above(theta: float, least: float, name: str) -> None:
    if not theta > least:
        raise ValueError(f"theta={theta:g} of {name} is not above {least:g}.")


Kind = Literal["linear", "spearman", "kendall", "scores"]


def nataf(
    marginals: Sequence[Marginal],
    correlations: Mapping[tuple[int, int], float],
    kind: Kind = "linear",
) -> GaussianCopula:
    r"""Gaussian copula under which the inputs themselves have the given correlations.

    Parameters
    ----------
    kind
        ``"linear"``: of the inputs, corrected to normal scores by solving
        :math:`\rho_{ij} \sigma_i \sigma_j = E[(x_i(z_i) - \mu_i)(x_j(z_j) - \mu_j)]`;
        ``"spearman"`` and ``"kendall"``: rank correlations, by
        :math:`2 \sin(\pi \rho / 6)` and :math:`\sin(\pi \tau / 2)`; ``"scores"``: as it is.

    References
    ----------
    .. [1] A. Der Kiureghian and P.-L. Liu, "Structural reliability under incomplete probability
       information", J. Eng. Mech. 112 (1986) 85-104.
    """
    matrix = np.eye(len(marginals))
    for (i, j), given in correlations.items():
        if i == j or not -1.0 < given < 1.0:
            raise ValueError(
                f"Correlation {given:g} of inputs {i} and {j}: give one in (-1, 1)."
            )
        if kind == "linear":
            value = corrected(marginals[i], marginals[j], given)
        elif kind == "spearman":
            value = 2.0 * np.sin(np.pi * given / 6.0)
        else:
            value = np.sin(0.5 * np.pi * given) if kind == "kendall" else given
        matrix[i, j] = matrix[j, i] = value
    return GaussianCopula(matrix)


def corrected(one: Marginal, other: Marginal, correlation: float) -> float:
    """Correlation of normal scores that gives two inputs the linear correlation wanted.

    Raises `ValueError` where no correlation of the scores gives the one wanted.

    Examples
    --------
    >>> from .marginals import marginal
    >>> law = marginal("lognormal", mean=1.0, sd=0.5)
    >>> exact = np.log1p(0.3 * 0.25) / np.log1p(0.25)  # of two lognormal inputs
    >>> bool(abs(corrected(law, law, 0.3) - exact) < 1e-6)
    True
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / weights.sum()
    x = (one.of_score(nodes) - one.mean) / one.sd

    def gap(rho: float) -> float:
        z = rho * nodes[:, None] + np.sqrt(1.0 - rho**2) * nodes[None, :]
        y = (other.of_score(z.ravel()).reshape(z.shape) - other.mean) / other.sd
        return float(weights @ (x[:, None] * y) @ weights) - correlation

    if not gap(-0.9999) < 0.0 < gap(0.9999):
        raise ValueError(
            f"No {one.name} and {other.name} inputs have the linear correlation "
            f"{correlation:g}. Lower it, or give a rank correlation."
        )
    return float(optimize.brentq(gap, -0.9999, 0.9999, xtol=1e-10))


def kendall(copula: Copula, inputs: int = 2, count: int = 4096) -> float:
    """Kendall's rank correlation of the first two inputs, from random points."""
    z = copula.scores(np.random.default_rng(0).standard_normal((count, inputs)))
    return float(scipy.stats.kendalltau(z[:, 0], z[:, 1]).statistic)
