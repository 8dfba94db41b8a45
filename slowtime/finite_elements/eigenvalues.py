"""Lowest modes of sparse models by shift-invert Lanczos, with a check that none is missing."""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from .factorization import SymmetricFactor, eigenvalues_below
from .parametric_matrices import ParametricMatrices

DENSE = 60
"""Rows up to which all modes are found by a dense solver, which is then the faster one."""

RIGID = 1e-6
"""Eigenvalue over the first elastic one [1] below which a motion counts as rigid: rounding of
K leaves rigid motions at about 1e-9 of it in models of 1e5 degrees of freedom."""

GUARD = 4
"""Modes found beyond those asked for, so that a close pair is not cut."""

GAP = 1e-4
"""Relative distance of two eigenvalues [1] between which a bound for the count is placed."""

COARSE = 1e-3
"""Shift over the smallest K_ii / M_ii [1] with which a structure without supports is started;
that ratio is an upper bound of the lowest elastic eigenvalue for most structures."""


class MissedModesError(ValueError):
    """The solver returned fewer modes below a bound than the matrices have."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SparseModes:
    r"""Lowest modes, ascending, mass-normalised: :math:`x_j^T M x_l = \delta_{jl}`.

    Parameters
    ----------
    eigenvalue
        Squares of the angular frequencies [rad^2/s^2]; 0 for rigid motions.
    residual
        :math:`\|K x_j - \lambda_j M x_j\| / \|K x_j\|` of each mode [1], over the size of
        :math:`\lambda M x` for rigid motions.
    counted
        Whether the number of eigenvalues below the last was confirmed by a Sturm count.
    """

    eigenvalue: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "own mode"]
    residual: Float[np.ndarray, " mode"]
    counted: bool

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.asarray(np.sqrt(self.eigenvalue) / (2 * np.pi))

    @property
    def rigid(self) -> int:
        """Number of rigid motions."""
        return int(np.sum(self.eigenvalue == 0.0))


def lowest_modes(
    stiffness: sparse.csr_array,
    mass: sparse.csr_array,
    count: int,
    *,
    check: bool = True,
    factor: SymmetricFactor | None = None,
    tolerance: float = 0.0,
) -> SparseModes:
    """Lowest modes of a sparse model.

    Parameters
    ----------
    check
        Whether to confirm by a Sturm count that no mode is missing, at the cost of one more
        factorisation.
    factor
        Factors of the stiffness matrix, where they exist already.
    tolerance
        Relative error of the eigenvalues at which the solver may stop [1]; 0 for rounding.

    Raises
    ------
    ValueError
        Where `count` is out of range.
    MissedModesError
        Where the Sturm count shows a mode that the solver did not find.
    """
    size = stiffness.shape[0]
    if not 0 < count <= size:
        raise ValueError(f"{count} modes of {size} degrees of freedom. Give 1 to {size}.")
    if size <= DENSE or count + GUARD >= size - 1:
        values, shapes = _dense(stiffness, mass, count)
        counted = True
    else:
        more = min(count + (GUARD if check else 0), size - 2)
        values, shapes = _shift_invert(stiffness, mass, more, factor, tolerance)
        counted = check and _confirm(stiffness, mass, values, count)
    values, shapes = _without_noise(values)[:count], shapes[:, :count]
    return SparseModes(
        eigenvalue=values,
        shapes=shapes * _signs(shapes),
        residual=_residuals(stiffness, mass, values, shapes),
        counted=counted,
    )


def nominal_modes(model: ParametricMatrices, count: int, *, check: bool = True) -> SparseModes:
    """Lowest modes of a model at zero parameters; see `lowest_modes`."""
    return lowest_modes(model.stiffness, model.mass, count, check=check)


def modes_below(model: ParametricMatrices, frequency_hz: float) -> int | None:
    """Count the modes of a model below a frequency without finding them.

    None where rounding forbids the count (move the frequency a little).
    """
    return eigenvalues_below(model.stiffness, model.mass, (2 * np.pi * frequency_hz) ** 2)


def _dense(
    stiffness: sparse.csr_array, mass: sparse.csr_array, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """All modes by the inverse problem where mass is singular, else directly."""
    k, m = stiffness.toarray(), mass.toarray()
    try:
        values, shapes = scipy.linalg.eigh(k, m)
    except scipy.linalg.LinAlgError:
        shift = COARSE * _smallest_ratio(stiffness, mass)
        inverse, shapes = scipy.linalg.eigh(m, k + shift * m)
        kept = np.flatnonzero(inverse > np.finfo(float).eps * len(k) * inverse[-1])[::-1]
        if len(kept) < count:
            raise ValueError(
                f"{count} modes were asked for, but only {len(kept)} degrees of freedom have "
                "mass. Ask for fewer."
            ) from None
        values = 1.0 / inverse[kept] - shift
        shapes = shapes[:, kept] / np.sqrt(inverse[kept])
    return values[: count + GUARD], shapes[:, : count + GUARD]


def _shift_invert(
    stiffness: sparse.csr_array,
    mass: sparse.csr_array,
    count: int,
    factor: SymmetricFactor | None,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray]:
    used = SymmetricFactor(stiffness) if factor is None else factor
    if not used.singular:
        return _lanczos(stiffness, mass, count, 0.0, used, tolerance)
    shift = -COARSE * _smallest_ratio(stiffness, mass)
    rough, _ = _lanczos(stiffness, mass, min(10, count), shift, None)
    # Move the shift to the size of the first elastic eigenvalue, where Lanczos is quickest.
    elastic = rough[rough > RIGID * np.abs(rough).max()]
    better = -0.5 * float(elastic[0]) if elastic.size else shift
    return _lanczos(stiffness, mass, count, max(better, shift), None, tolerance)


def _lanczos(
    stiffness: sparse.csr_array,
    mass: sparse.csr_array,
    count: int,
    shift: float,
    factor: SymmetricFactor | None,
    tolerance: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    size = stiffness.shape[0]
    if factor is None:
        factor = SymmetricFactor(sparse.csr_array(stiffness - shift * mass))
    operator = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    # A fixed start makes runs repeat; it is not symmetric, so that no mode is orthogonal to it.
    start = 1.0 + np.modf(np.arange(1, size + 1) * 0.6180339887498949)[0]
    basis = min(size - 1, max(2 * count + 1, 20))
    try:
        values, shapes = eigsh(
            stiffness,
            count,
            _weighing(mass),
            sigma=shift,
            OPinv=operator,
            v0=start,
            ncv=basis,
            tol=tolerance,
        )
    except ArpackNoConvergence as error:
        raise MissedModesError(
            f"Only {len(error.eigenvalues)} of {count} modes converged. Ask for fewer modes, "
            "or check the model for parts that are not joined."
        ) from None
    order = np.argsort(values)
    return values[order], shapes[:, order]


def _weighing(mass: sparse.csr_array) -> sparse.csr_array | LinearOperator:
    """Mass for the solver; of a lumped one the products alone, without checks of each."""
    # The solver takes two to three products with the mass for each solution.
    diagonal = mass.diagonal()
    if np.count_nonzero(mass.data) > np.count_nonzero(diagonal):
        return mass
    return LinearOperator(mass.shape, matvec=diagonal.__mul__, dtype=np.float64)


def _smallest_ratio(stiffness: sparse.csr_array, mass: sparse.csr_array) -> float:
    k, m = stiffness.diagonal(), mass.diagonal()
    heavy = (m > 0) & (k > 0)
    if not heavy.any():
        raise ValueError(
            "The matrices have no mass where there is stiffness. Give a mass matrix of the "
            "same degrees of freedom."
        )
    return float((k[heavy] / m[heavy]).min())


def _confirm(
    stiffness: sparse.csr_array, mass: sparse.csr_array, values: np.ndarray, count: int
) -> bool:
    """Compare the number of modes found below a bound with a Sturm count."""
    steps = np.diff(values[count - 1 :])
    wide = np.flatnonzero(steps > GAP * np.abs(values[count:]))
    if not wide.size:
        return False
    last = count - 1 + int(wide[0])
    bound = 0.5 * (values[last] + values[last + 1])
    below = eigenvalues_below(stiffness, mass, float(bound))
    if below is not None and below != last + 1:
        raise MissedModesError(
            f"{below} modes lie below {np.sqrt(bound) / (2 * np.pi):.6g} Hz, but the solver "
            f"found {last + 1}. Ask for a different number of modes."
        )
    return below is not None


def _without_noise(values: np.ndarray) -> np.ndarray:
    """Eigenvalues with those of rigid motions set to zero."""
    scale = np.abs(values[np.abs(values) > RIGID * np.abs(values).max()]).min()
    if values[0] < -RIGID * scale:
        raise ValueError(
            f"The stiffness matrix has a negative eigenvalue ({values[0]:.4g} rad^2/s^2). "
            "Check the signs of stiffnesses and springs."
        )
    return np.where(np.abs(values) < RIGID * scale, 0.0, values)


def _residuals(
    stiffness: sparse.csr_array, mass: sparse.csr_array, values: np.ndarray, shapes: np.ndarray
) -> np.ndarray:
    inertia = (mass @ shapes) * values
    elastic = stiffness @ shapes
    scale = np.linalg.norm(inertia, axis=0)
    floor = scale[scale > 0].min(initial=np.inf)
    scale = np.where(scale > 0, scale, floor if np.isfinite(floor) else 1.0)
    return np.asarray(np.linalg.norm(elastic - inertia, axis=0) / scale)


def _signs(shapes: np.ndarray) -> np.ndarray:
    """Sign of the largest component of each shape, the first of those of nearly equal size."""
    size = np.abs(shapes)
    first = np.argmax(size > (1 - 1e-6) * size.max(axis=0), axis=0)
    return np.asarray(np.sign(shapes[first, np.arange(shapes.shape[1])]))
