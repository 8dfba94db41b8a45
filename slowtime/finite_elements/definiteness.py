r"""Ranges of parameters over which a stiffness matrix stays positive.

.. math:: K + \theta K_p \succ 0 \iff 1 + \theta \mu > 0 \text{ for all } \mu, \qquad
          K_p x = \mu K x

A group that is a part of the whole has :math:`0 \le \mu \le 1`: it may lose all of itself, and
gain without bound.
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from .factorization import SymmetricFactor
from .parametric_matrices import ParametricMatrices

DENSE = 200
"""Degrees of freedom up to which all eigenvalues are found at once, in some 10 ms."""

ROUNDING = 1e-6
"""Part of a bound [1] that text files with six digits leave uncertain."""

GROUNDED = 1e-6
"""Share of the mass-weighted mean stiffness that holds a structure free to move [1]."""


class IndefiniteStiffnessError(ValueError):
    """A stiffness matrix with negative eigenvalues; the text names the group and its range."""


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterRange:
    """Values of one parameter, the others zero, at which the stiffness is positive.

    Bounds are relative changes [1].
    """

    name: str
    lower: float
    upper: float

    @property
    def is_part(self) -> bool:
        """Whether the group may lose all of itself and gain without bound."""
        return self.lower <= -1.0 + ROUNDING and math.isinf(self.upper)

    @property
    def words(self) -> str:
        """Say the range, as in ``'deck' from -0.67 up``."""
        if math.isinf(self.upper):
            return f"{self.name!r} from {self.lower:.3g} up"
        return f"{self.name!r} from {self.lower:.3g} to {self.upper:.3g}"


def parameter_ranges(model: ParametricMatrices) -> tuple[ParameterRange, ...]:
    """Find the range of each parameter that acts on the stiffness.

    The stiffness at zero parameters has no negative eigenvalue.
    """
    whole, factor = _held(model)
    return tuple(
        _range(name, part, whole, factor)
        for name, part in zip(model.names, model.stiffness_parts, strict=True)
        if part is not None
    )


def check_definite(
    model: ParametricMatrices, theta: Float[np.ndarray, " parameter"], factor: SymmetricFactor
) -> None:
    """Refuse parameters at which the stiffness has negative eigenvalues.

    Pivots of the factors have the signs of the eigenvalues. Raises `IndefiniteStiffnessError`,
    which names the groups whose stiffness exceeds that of the whole model, and their ranges.
    """
    if factor.singular or not factor.symmetric or not factor.negative:
        return
    if not theta.any() or not model.names:
        raise IndefiniteStiffnessError(
            f"The stiffness matrix has {factor.negative} negative eigenvalues. Check the signs "
            "of stiffnesses and springs."
        )
    raise IndefiniteStiffnessError(
        "The stiffness matrix has negative eigenvalues at the parameters "
        f"{_tried(model.names, theta):.200}. {_reason(model)}"
    )


def indefinite_reduced_stiffness(
    names: tuple[str, ...],
    stiffness: Float[np.ndarray, "coordinate coordinate"],
    parts: Float[np.ndarray, "parameter coordinate coordinate"],
    theta: Float[np.ndarray, " parameter"],
) -> IndefiniteStiffnessError:
    """Make the error of a reduced model whose stiffness has negative eigenvalues.

    It names the groups whose stiffness exceeds that of the model, and their ranges over the
    motions that the reduced model has; those of the full model are as wide or narrower.
    """
    floor = GROUNDED * float(np.trace(stiffness)) / len(stiffness)
    whole = stiffness + max(floor - float(np.linalg.eigvalsh(stiffness)[0]), 0.0) * np.eye(
        len(stiffness)
    )

    def range_of(name: str, part: np.ndarray) -> ParameterRange:
        values = scipy.linalg.eigh(part, whole, eigvals_only=True)
        return _between(name, float(values[0]), float(values[-1]))

    ranges = [range_of(name, part) for name, part in zip(names, parts, strict=True)]
    together = range_of("all groups together", parts.sum(axis=0))
    return IndefiniteStiffnessError(
        "The stiffness of the reduced model has negative eigenvalues at the parameters "
        f"{_tried(names, theta):.200}. {_reason_of(ranges, lambda: together)}"
    )


def _tried(names: tuple[str, ...], theta: np.ndarray) -> str:
    return ", ".join(
        f"{name} {value:+.3g}" for name, value in zip(names, theta.tolist(), strict=True)
    )


def _reason(model: ParametricMatrices) -> str:
    def together() -> ParameterRange:
        whole, factor = _held(model)
        parts = [part for part in model.stiffness_parts if part is not None]
        every = sparse.csr_array(functools.reduce(operator.add, parts))
        return _range("all groups together", every, whole, factor)

    return _reason_of(parameter_ranges(model), together)


def _reason_of(ranges: Sequence[ParameterRange], together: Callable[[], ParameterRange]) -> str:
    wrong = [one for one in ranges if not one.is_part]
    if wrong:
        return (
            f"Allowed alone: {'; '.join(one.words for one in wrong)}. A group whose stiffness "
            "is contained in that of the model may lose all of it (-1) and gain without bound: "
            "check the file of this group and its `change`, or try smaller parameters "
            "(--setting span)."
        )
    return (
        f"Each group alone is part of the whole, but {together().words} only: they overlap. "
        "Check that no element is in two groups, or try smaller parameters (--setting span)."
    )


def _held(model: ParametricMatrices) -> tuple[sparse.csr_array, SymmetricFactor]:
    """Stiffness at zero parameters, held slightly where the structure is free to move."""
    whole = model.stiffness
    factor = SymmetricFactor(whole)
    if factor.singular:
        mean = float(whole.diagonal().sum()) / float(model.mass.diagonal().sum())
        whole = sparse.csr_array(whole + GROUNDED * mean * model.mass)
        factor = SymmetricFactor(whole)
    return whole, factor


def _range(
    name: str, part: sparse.csr_array, whole: sparse.csr_array, factor: SymmetricFactor
) -> ParameterRange:
    return _between(name, *_extremes(part, whole, factor))


def _between(name: str, least: float, most: float) -> ParameterRange:
    lower = -1.0 / most if most > ROUNDING else -math.inf
    upper = -1.0 / least if least < -ROUNDING else math.inf
    return ParameterRange(name, lower, upper)


def _extremes(
    part: sparse.csr_array, whole: sparse.csr_array, factor: SymmetricFactor
) -> tuple[float, float]:
    """Smallest and largest eigenvalue of a part in the metric of the whole [1]."""
    size = whole.shape[0]
    if size <= DENSE:
        values = scipy.linalg.eigh(part.toarray(), whole.toarray(), eigvals_only=True)
        return float(values[0]), float(values[-1])
    solve = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    start = 1.0 + np.modf(np.arange(1, size + 1) * 0.6180339887498949)[0]
    found = []
    for end in ("SA", "LA"):
        try:
            values = eigsh(
                part, 1, whole, Minv=solve, which=end, v0=start, tol=ROUNDING,
                return_eigenvectors=False,
            )  # fmt: skip
        except ArpackNoConvergence as error:
            values = error.eigenvalues if len(error.eigenvalues) else np.zeros(1)
        found.append(float(values[0]))
    return found[0], found[1]
