r"""Sparse matrices that depend linearly on parameters.

.. math:: K(\theta) = K_0 + \sum_i \theta_i K_i, \qquad M(\theta) = M_0 + \sum_i \theta_i M_i

With :math:`K_i` what group i contributes as built, :math:`\theta_i = -0.1` is a loss of a
tenth of its stiffness.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from .degrees_of_freedom import DofMap

ASYMMETRY = 1e-8
"""Relative asymmetry [1] above which a matrix is taken for wrong: text files often keep ten
digits only."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ParametricMatrices:
    """Mass and stiffness of a model and the parts of them that its parameters scale.

    Parameters
    ----------
    stiffness, mass
        At zero parameters, symmetric [N/m, kg].
    stiffness_parts, mass_parts
        One for each parameter, or None for a parameter that does not act on it.
    damping
        At zero parameters [N s/m]; None where it is not modelled.
    dofs
        What each degree of freedom is, before constraints; None where unknown.
    expansion
        Degrees of freedom before constraints from those of the matrices; None where there are
        no constraints.
    """

    stiffness: sparse.csr_array
    mass: sparse.csr_array
    names: tuple[str, ...] = ()
    stiffness_parts: tuple[sparse.csr_array | None, ...] = ()
    mass_parts: tuple[sparse.csr_array | None, ...] = ()
    damping: sparse.csr_array | None = None
    dofs: DofMap | None = None
    expansion: sparse.csr_array | None = None

    def __post_init__(self) -> None:
        """Refuse matrices that do not belong together."""
        count = len(self.names)
        for name in ("stiffness_parts", "mass_parts"):
            parts = getattr(self, name) or (None,) * count
            object.__setattr__(self, name, parts)
            if len(parts) != count:
                raise ValueError(
                    f"{len(parts)} {name} were given for {count} parameters. Give one for "
                    "each, None for a parameter that does not act."
                )
        if len(set(self.names)) < count:
            raise ValueError(f"Names {self.names} are not unique. Give each parameter its own.")
        square = (self.size, self.size)
        for name, matrix in self._named():
            if matrix.shape != square:
                raise ValueError(
                    f"The {name} matrix has shape {matrix.shape}. Allowed is {square}, that of "
                    "the stiffness matrix."
                )
            check_symmetric(name, matrix)
        rows = self.size if self.expansion is None else self.expansion.shape[0]
        if self.dofs is not None and self.dofs.size != rows:
            raise ValueError(
                f"The map has {self.dofs.size} degrees of freedom, the matrices have {rows}. "
                "Give one node and direction for each row of the matrices."
            )

    def _named(self) -> list[tuple[str, sparse.csr_array]]:
        named = [("stiffness", self.stiffness), ("mass", self.mass)]
        if self.damping is not None:
            named.append(("damping", self.damping))
        for what, parts in (("stiffness", self.stiffness_parts), ("mass", self.mass_parts)):
            named += [
                (f"{what} of {name}", part)
                for name, part in zip(self.names, parts, strict=True)
                if part is not None
            ]
        return named

    @property
    def size(self) -> int:
        """Number of rows of the matrices."""
        return int(self.stiffness.shape[0])

    @functools.cached_property
    def stiffness_family(self) -> "MatrixFamily":
        """The stiffness as a family over the parameters."""
        return MatrixFamily(self.stiffness, self.stiffness_parts)

    @functools.cached_property
    def mass_family(self) -> "MatrixFamily":
        """The mass as a family over the parameters."""
        return MatrixFamily(self.mass, self.mass_parts)

    def at(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Stiffness and mass at values of the parameters.

        Parameters are relative changes of the parts [1].
        """
        return self.stiffness_family.at(theta), self.mass_family.at(theta)

    def rows(self, sensors: Float[np.ndarray, "sensor dof"]) -> Float[np.ndarray, "sensor own"]:
        """Sensor rows over the coordinates of the matrices, from rows over all of `dofs`."""
        return sensors if self.expansion is None else np.asarray(sensors @ self.expansion)

    def expand(self, shapes: Float[np.ndarray, "own mode"]) -> Float[np.ndarray, "dof mode"]:
        """Shapes over all of `dofs`, from shapes over the coordinates of the matrices."""
        return shapes if self.expansion is None else np.asarray(self.expansion @ shapes)


FEW_ROWS = 8
"""Rows of a part below which one sum over all parts is quicker than a product for each."""


class MatrixFamily:
    """A sparse matrix and its parts, on the union of their patterns.

    The nominal matrix is that at zero parameters; a part is None where a parameter does not
    act.
    """

    def __init__(
        self, nominal: sparse.csr_array, parts: Sequence[sparse.csr_array | None]
    ) -> None:
        self.nominal = sparse.csr_array(nominal)
        self.count = len(parts)
        self._own = [
            (i, sparse.csr_array(part)) for i, part in enumerate(parts) if part is not None
        ]

    @functools.cached_property
    def _pattern(self) -> tuple[sparse.csr_array, sparse.csc_array]:
        """Nominal matrix on the union of all patterns, and the values of each part there."""
        size = self.nominal.shape[0]
        coded = [_coded(self.nominal), *(_coded(part) for _, part in self._own)]
        union = np.unique(np.concatenate([keys for keys, _ in coded]))
        values = np.zeros(len(union))
        values[np.searchsorted(union, coded[0][0])] = coded[0][1]
        rows = [np.searchsorted(union, keys) for keys, _ in coded[1:]]
        columns = [np.full(len(r), i) for r, (i, _) in zip(rows, self._own, strict=True)]
        data = [value for _, value in coded[1:]]
        slopes = sparse.csc_array(
            (_joined(data), (_joined(rows).astype(int), _joined(columns).astype(int))),
            shape=(len(union), self.count),
        )
        starts = np.searchsorted(union, np.arange(size + 1, dtype=np.int64) * size)
        base = sparse.csr_array((values, union % size, starts), shape=(size, size))
        return base, slopes

    def at(self, theta: Float[np.ndarray, " parameter"]) -> sparse.csr_array:
        """Matrix at values of the parameters."""
        if not self._own:
            return self.nominal
        base, slopes = self._pattern
        return sparse.csr_array(
            (base.data + slopes @ theta, base.indices, base.indptr), shape=base.shape
        )

    @functools.cached_property
    def _stacked(self) -> tuple[sparse.csr_array, Int[np.ndarray, " row"], list[int]]:
        """Rows of all parts that are not empty, one part below the other."""
        blocks, rows, ends = [], [], [0]
        for _, part in self._own:
            busy = np.flatnonzero(np.diff(part.indptr))
            blocks.append(part[busy])
            rows.append(busy)
            ends.append(ends[-1] + len(busy))
        stacked = sparse.csr_array(sparse.vstack(blocks, format="csr"))
        return stacked, np.concatenate(rows), ends

    def project(
        self, left: Float[np.ndarray, "own left"], right: Float[np.ndarray, "own right"]
    ) -> Float[np.ndarray, "parameter left right"]:
        r"""Compute :math:`L^T K_i R` of every part, over the rows that the part has."""
        found = np.zeros((self.count, left.shape[1], right.shape[1]))
        if not self._own:
            return found
        stacked, rows, ends = self._stacked
        product = stacked @ right
        if len(rows) < FEW_ROWS * len(self._own):
            pairs = left[rows][:, :, None] * product[:, None, :]
            return self._summed(pairs)
        for k, (i, _) in enumerate(self._own):
            part = slice(ends[k], ends[k + 1])
            found[i] = left[rows[part]].T @ product[part]
        return found

    def contract(
        self,
        left: Float[np.ndarray, "own left vector"],
        right: Float[np.ndarray, "own vector"],
    ) -> Float[np.ndarray, "parameter left vector"]:
        r"""Compute :math:`L_j^T K_i r_j` of every part, for pairs of a matrix and a vector."""
        if not self._own:
            return np.zeros((self.count, *left.shape[1:]))
        stacked, rows, _ = self._stacked
        return self._summed(left[rows] * (stacked @ right)[:, None, :])

    @functools.cached_property
    def _sums(self) -> sparse.csr_array:
        """Matrix that adds up the stacked rows of each parameter."""
        ends = self._stacked[2]
        owner = np.repeat([i for i, _ in self._own], np.diff(ends))
        count = len(owner)
        return sparse.csr_array(
            (np.ones(count), (owner, np.arange(count))), shape=(self.count, count)
        )

    def _summed(self, terms: np.ndarray) -> np.ndarray:
        flat = self._sums @ terms.reshape(len(terms), math.prod(terms.shape[1:]))
        return np.asarray(flat).reshape(self.count, *terms.shape[1:])

    @property
    def acts(self) -> bool:
        """Whether any parameter acts on the matrix."""
        return bool(self._own)

    def times(self, vectors: Float[np.ndarray, "own vector"], which: int) -> np.ndarray:
        """Product of one part with vectors; zeros where the parameter does not act."""
        for i, part in self._own:
            if i == which:
                return np.asarray(part @ vectors)
        return np.zeros_like(vectors)


def check_symmetric(name: str, matrix: sparse.csr_array) -> None:
    """Refuse a matrix that is not symmetric or has values that are not finite.

    Raises `ValueError`.
    """
    if not np.isfinite(matrix.data).all():
        raise ValueError(
            f"The {name} matrix has entries that are not finite. Export it again from the "
            "program that made it."
        )
    skew = np.abs((matrix - matrix.T).data).max(initial=0.0)
    largest = np.abs(matrix.data).max(initial=0.0)
    if skew > ASYMMETRY * largest:
        raise ValueError(
            f"The {name} matrix is not symmetric: opposite entries differ by {skew:.3g} where "
            f"the largest entry is {largest:.3g}. Give a symmetric matrix; if only one "
            "triangle was exported, mirror it."
        )


def _coded(matrix: sparse.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the entries, row by row, and their values, duplicates summed."""
    entries = matrix.tocoo()
    keys = entries.row.astype(np.int64) * matrix.shape[0] + entries.col
    unique, inverse = np.unique(keys, return_inverse=True)
    return unique, np.bincount(inverse, weights=entries.data, minlength=len(unique))


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(0)
