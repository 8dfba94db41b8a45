r"""Covariance functions of several inputs, with derivatives to their parameters.

A slope is never formed as a matrix: what likelihoods need is
:math:`\sum_{ij} G_{ij} \, \partial K_{ij} / \partial \theta`, which costs one pass over K.
Inputs come scaled to the box of the design, outputs to unit variance; bounds and priors of the
parameters are in those units.

Several functions share these parameters:

- `theta`: parameters of the function, in the order of `ranges`.
- `a`: scaled points [sample, input].
- `weight`: symmetric weights G [sample, sample].
"""

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

Inputs = Float[np.ndarray, "sample input"]


@dataclasses.dataclass(frozen=True, slots=True)
class Range:
    """Where one logarithmic parameter may lie, and a Gaussian belief about it."""

    name: str
    lo: float
    hi: float
    centre: float
    sd: float


@runtime_checkable
class Covariance(Protocol):
    """What a likelihood asks of a covariance function."""

    def ranges(self, inputs: int) -> list[Range]:
        """Its parameters, for that many inputs."""

    def between(self, theta: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of the points `a` with the points `b`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a, b
            Scaled points [sample, input].

        Returns
        -------
        Covariances [sample of a, sample of b].
        """

    def variance(self, theta: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Variance at the points `a`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a
            Scaled points [sample, input].

        Returns
        -------
        Variances [sample].
        """

    def slopes(self, theta: np.ndarray, a: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum a symmetric `weight` times the covariance's derivative to each parameter.

        Returns
        -------
        Sums [parameter].
        """


def _size(name: str) -> Range:
    return Range(f"log_sd_{name}", -7.0, 6.0, 0.0, 2.0)


def _exponential(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    decay = np.exp(-r)
    return decay, decay / np.maximum(r, 1e-12)


def _matern32(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    s = np.sqrt(3.0) * r
    decay = np.exp(-s)
    return (1.0 + s) * decay, 3.0 * decay


def _matern52(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    s = np.sqrt(5.0) * r
    decay = np.exp(-s)
    return (1.0 + s + s**2 / 3.0) * decay, (5.0 / 3.0) * (1.0 + s) * decay


def _squared_exponential(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    decay = np.exp(-0.5 * r**2)
    return decay, decay


Shape = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Correlation at a scaled distance r, and minus its slope over r."""

SHAPES: dict[str, Shape] = {
    "matern12": _exponential,
    "matern32": _matern32,
    "matern52": _matern52,
    "squared exponential": _squared_exponential,
}


@dataclasses.dataclass(frozen=True, slots=True)
class Stationary:
    r""":math:`\sigma^2 \rho(r)`, :math:`r^2 = \sum_d (x_d - x'_d)^2 / \ell_d^2`."""

    shape: str = "matern52"

    def ranges(self, inputs: int) -> list[Range]:
        """Logarithms of the spread and of one length per input."""
        # More inputs, longer lengths: else no point of a design would know of another.
        centre = float(np.sqrt(2.0) + 0.5 * np.log(inputs)) - 1.0
        each = [Range(f"log_length_{d}", -3.5, 5.0, centre, 1.7) for d in range(inputs)]
        return [_size(self.shape), *each]

    def between(self, theta: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of the points `a` with the points `b`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a, b
            Scaled points [sample, input].

        Returns
        -------
        Covariances [sample of a, sample of b].
        """
        correlation, _ = SHAPES[self.shape](_distance(a, b, theta[1:]))
        return np.asarray(np.exp(2.0 * theta[0]) * correlation)

    def variance(self, theta: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Variance at the points `a`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a
            Scaled points [sample, input].

        Returns
        -------
        Variances [sample].
        """
        return np.full(len(a), np.exp(2.0 * theta[0]))

    def slopes(self, theta: np.ndarray, a: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum a symmetric `weight` times the covariance's derivative to each parameter.

        Returns
        -------
        Sums [parameter].
        """
        correlation, steep = SHAPES[self.shape](_distance(a, a, theta[1:]))
        variance = np.exp(2.0 * theta[0])
        part = variance * weight * steep
        np.fill_diagonal(part, 0.0)
        scaled = a / np.exp(theta[1:])
        row = part.sum(axis=1) @ scaled**2
        lengths = 2.0 * (row - np.sum(scaled * (part @ scaled), axis=0))
        return np.concatenate([[2.0 * variance * np.sum(weight * correlation)], lengths])


def _distance(a: np.ndarray, b: np.ndarray, log_lengths: np.ndarray) -> np.ndarray:
    a, b = a / np.exp(log_lengths), b / np.exp(log_lengths)
    return np.asarray(cdist(a, b))


@dataclasses.dataclass(frozen=True, slots=True)
class PeriodicCovariance:
    r""":math:`\sigma^2 \exp(-2 \sum_d \sin^2(\pi (x_d - x'_d) / p_d) / \ell_d^2)`."""

    def ranges(self, inputs: int) -> list[Range]:
        """Logarithms of the spread, of one length and of one period per input."""
        lengths = [Range(f"log_length_{d}", -3.0, 4.0, 0.3, 1.0) for d in range(inputs)]
        periods = [Range(f"log_period_{d}", -3.5, 1.5, -1.0, 1.0) for d in range(inputs)]
        return [_size("periodic"), *lengths, *periods]

    def between(self, theta: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of the points `a` with the points `b`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a, b
            Scaled points [sample, input].

        Returns
        -------
        Covariances [sample of a, sample of b].
        """
        length, period = np.exp(theta[1:]).reshape(2, -1)
        exponent = np.zeros((len(a), len(b)))
        for d in range(a.shape[1]):
            turn = np.sin(np.pi * (a[:, d, None] - b[:, d]) / period[d])
            exponent += (turn / length[d]) ** 2
        return np.asarray(np.exp(2.0 * theta[0] - 2.0 * exponent))

    def variance(self, theta: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Variance at the points `a`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a
            Scaled points [sample, input].

        Returns
        -------
        Variances [sample].
        """
        return np.full(len(a), np.exp(2.0 * theta[0]))

    def slopes(self, theta: np.ndarray, a: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum a symmetric `weight` times the covariance's derivative to each parameter.

        Returns
        -------
        Sums [parameter].
        """
        length, period = np.exp(theta[1:]).reshape(2, -1)
        part = weight * self.between(theta, a, a)
        lengths, periods = [], []
        for d in range(a.shape[1]):
            angle = np.pi * (a[:, d, None] - a[:, d]) / period[d]
            lengths.append(np.sum(part * 4.0 * np.sin(angle) ** 2) / length[d] ** 2)
            periods.append(np.sum(part * 2.0 * np.sin(2.0 * angle) * angle) / length[d] ** 2)
        return np.array([2.0 * part.sum(), *lengths, *periods])


@dataclasses.dataclass(frozen=True, slots=True)
class Expanded:
    r"""Expansion of random coefficients: :math:`\sum_\alpha v_\alpha \psi_\alpha \psi_\alpha`.

    .. math:: v_\alpha = \tau^2 \, \kappa^{|\mathrm{supp}\,\alpha| - 1} \prod_i r_i^{\alpha_i}

    so that degree costs by input (:math:`r_i`) and interaction costs (:math:`\kappa`). The mean
    of a process with this covariance is homotopy regression with weights
    :math:`w_\alpha = 1 / v_\alpha`, learnt rather than set; see `homotopy.homotopy`.
    """

    terms: Int[np.ndarray, "term input"]
    design: Callable[[Inputs], Float[np.ndarray, "sample term"]]

    def ranges(self, inputs: int) -> list[Range]:
        """Logarithms of the spread, of the price of interaction, and of decay per input."""
        each = [Range(f"log_decay_{d}", -12.0, 1.0, -1.5, 2.0) for d in range(inputs)]
        return [_size("expansion"), Range("log_interaction", -10.0, 4.0, -1.0, 2.0), *each]

    def variances(self, theta: np.ndarray) -> Float[np.ndarray, " term"]:
        """Prior variance of each coefficient of the expansion."""
        together = np.maximum(np.sum(self.terms > 0, axis=1) - 1, 0)
        exponent = 2.0 * theta[0] + theta[1] * together + self.terms @ theta[2:]
        found: Float[np.ndarray, " term"] = np.exp(exponent)
        return found

    def between(self, theta: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of the points `a` with the points `b`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a, b
            Scaled points [sample, input].

        Returns
        -------
        Covariances [sample of a, sample of b].
        """
        return np.asarray((self.design(a) * self.variances(theta)) @ self.design(b).T)

    def variance(self, theta: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Variance at the points `a`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a
            Scaled points [sample, input].

        Returns
        -------
        Variances [sample].
        """
        return np.asarray(self.design(a) ** 2 @ self.variances(theta))

    def slopes(self, theta: np.ndarray, a: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum a symmetric `weight` times the covariance's derivative to each parameter.

        Returns
        -------
        Sums [parameter].
        """
        values = self.design(a)
        each = self.variances(theta) * np.sum(values * (weight @ values), axis=0)
        together = np.maximum(np.sum(self.terms > 0, axis=1) - 1, 0)
        return np.array([2.0 * each.sum(), together @ each, *(self.terms.T @ each)])


@dataclasses.dataclass(frozen=True, slots=True)
class SumCovariance:
    """Several covariance functions added: each explains a part."""

    parts: tuple[Covariance, ...]

    def ranges(self, inputs: int) -> list[Range]:
        """Parameters of all parts, in their order."""
        return [one for part in self.parts for one in part.ranges(inputs)]

    def split(self, theta: np.ndarray, inputs: int) -> list[np.ndarray]:
        """Split the parameters of the sum into those of each part.

        Parameters
        ----------
        theta
            Parameters of all parts, one part after the other.
        inputs
            Number of inputs.

        Returns
        -------
        Parameters of each part.
        """
        ends = np.cumsum([len(part.ranges(inputs)) for part in self.parts])
        return np.split(theta, ends[:-1])

    def between(self, theta: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of the points `a` with the points `b`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a, b
            Scaled points [sample, input].

        Returns
        -------
        Covariances [sample of a, sample of b].
        """
        own = zip(self.parts, self.split(theta, a.shape[1]), strict=True)
        return np.asarray(sum(part.between(its, a, b) for part, its in own))

    def variance(self, theta: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Variance at the points `a`.

        Parameters
        ----------
        theta
            Parameters of the function, in the order of `ranges`.
        a
            Scaled points [sample, input].

        Returns
        -------
        Variances [sample].
        """
        own = zip(self.parts, self.split(theta, a.shape[1]), strict=True)
        return np.asarray(sum(part.variance(its, a) for part, its in own))

    def slopes(self, theta: np.ndarray, a: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum a symmetric `weight` times the covariance's derivative to each parameter.

        Returns
        -------
        Sums [parameter].
        """
        own = zip(self.parts, self.split(theta, a.shape[1]), strict=True)
        return np.concatenate([part.slopes(its, a, weight) for part, its in own])


def covariance(name: str) -> Covariance:
    """Covariance function by name, as ``"matern52"`` or ``"matern52 + periodic"``."""
    parts: list[Covariance] = []
    for one in (word.strip() for word in name.split("+")):
        if one not in (*SHAPES, "periodic"):
            raise ValueError(
                f"{one!r} is not a valid covariance function. Allowed: "
                f"{', '.join(SHAPES)}, periodic, "
                "and sums of them with +."
            )
        parts.append(PeriodicCovariance() if one == "periodic" else Stationary(one))
    return parts[0] if len(parts) == 1 else SumCovariance(tuple(parts))
