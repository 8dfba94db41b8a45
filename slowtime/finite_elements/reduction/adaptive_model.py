r"""A reduced model whose basis follows the parameters.

The nominal modes X and the responses to the change of the stiffness,

.. math:: V(\theta) = \Big[ X, \; A^{-1} \sum_p \frac{\theta_p}{1 + \theta_p} K_p X, \;
          A^{-1} \sum_p \theta_p M_p X \Big],

are twice as many coordinates as modes (three times with parameters of the mass), whatever the
number of parameters. The factor
:math:`\theta / (1 + \theta)` makes the response exact where a part carries a force that does
not depend on its stiffness (statically determinate structures); elsewhere what is left is of
second order in the shape and of fourth order in the frequency.

All this happens in a space W of a few hundred candidates that holds every such response, with
each part as the product of few columns, :math:`W^T K_p W = B_p S_p B_p^T`, so that neither
the full model nor a sum of large matrices is needed.

References
----------
.. [1] U. Kirsch, "Reanalysis of Structures", Springer (2008) (combined approximations).
.. [2] A. Bobillot, E. Balmès, "Iterative techniques for eigenvalue solutions of damped
   structures coupled with fluids", AIAA-2002-1391 (2002) (residues as basis vectors).
"""

import dataclasses
import functools
import math

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DofMap
from slowtime.finite_elements.sensitivities import ModeSlopes, SolvedModel

from .reduced_model import (
    ReducedModes,
    ReductionError,
    lowest_with_slopes,
    orthonormal_mixture,
)

NOISE = 1e-8
"""Part of a response across the fixed columns, over the response [1], that is rounding."""

LARGEST = 0.95
"""Loss of a part [1] at which the factor of its response stops growing."""

SLOPE_MODES = 2.0
"""Modes found for slopes over those whose slopes are wanted [1]; the series for the rest
then converges by a factor of four or more a term for most structures."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FactoredParts:
    """Small symmetric matrices :math:`B_p S_p B_p^T`, one for each parameter.

    Parameters
    ----------
    columns
        All B side by side.
    sign
        Diagonal of all S: 1 or -1.
    owner
        Parameter of each column, ascending.
    """

    columns: Float[np.ndarray, "coordinate column"]
    sign: Float[np.ndarray, " column"]
    owner: np.ndarray
    count: int

    @classmethod
    def of(
        cls, parts: Float[np.ndarray, "parameter coordinate coordinate"], negligible: float
    ) -> "FactoredParts":
        """Factor matrices, without eigenvalues of at most `negligible`."""
        columns, signs, owners = [np.zeros((parts.shape[1], 0))], [np.zeros(0)], [np.zeros(0)]
        for p, part in enumerate(parts):
            if not part.any():
                continue
            values, vectors = scipy.linalg.eigh(part)
            kept = np.abs(values) > negligible
            columns.append(vectors[:, kept] * np.sqrt(np.abs(values[kept])))
            signs.append(np.sign(values[kept]))
            owners.append(np.full(int(kept.sum()), p))
        owner = np.concatenate(owners).astype(int)
        return cls(
            np.ascontiguousarray(np.concatenate(columns, axis=1)),
            np.concatenate(signs),
            owner,
            len(parts),
        )

    @property
    def acts(self) -> bool:
        """Whether any parameter acts."""
        return bool(self.columns.size)

    def weights(self, theta: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, " column"]:
        """Factor of each column in the sum over the parameters."""
        return np.asarray(self.sign * theta[self.owner])

    def quadratic(
        self,
        theta: Float[np.ndarray, " parameter"],
        basis: Float[np.ndarray, "coordinate basis"],
    ) -> Float[np.ndarray, "basis basis"]:
        """Weighted sum of all parts, over a basis."""
        inside = self.columns.T @ basis
        return np.asarray(inside.T @ (self.weights(theta)[:, None] * inside))

    def dense(self) -> Float[np.ndarray, "parameter coordinate coordinate"]:
        """Return the matrices themselves."""
        every = np.eye(len(self.columns))
        return self.project(every, every)

    def project(
        self,
        left: Float[np.ndarray, "coordinate left"],
        right: Float[np.ndarray, "coordinate right"],
    ) -> Float[np.ndarray, "parameter left right"]:
        r"""Compute :math:`L^T K_p R` of every part."""
        one, other = self.columns.T @ left, self.sign[:, None] * (self.columns.T @ right)
        found = np.zeros((self.count, left.shape[1], right.shape[1]))
        edges = np.searchsorted(self.owner, np.arange(self.count + 1))
        for p in range(self.count):
            inside = slice(edges[p], edges[p + 1])
            found[p] = one[inside].T @ other[inside]
        return found

    def contract(
        self,
        left: Float[np.ndarray, "coordinate left vector"],
        right: Float[np.ndarray, "coordinate vector"],
    ) -> Float[np.ndarray, "parameter left vector"]:
        r"""Compute :math:`L_j^T K_p r_j` of every part."""
        inside = self.columns.T @ left.reshape(len(left), math.prod(left.shape[1:]))
        other = self.sign[:, None] * (self.columns.T @ right)
        terms = inside.reshape(len(inside), *left.shape[1:]) * other[:, None, :]
        edges = np.searchsorted(self.owner, np.arange(self.count + 1))
        return np.array([terms[edges[p] : edges[p + 1]].sum(axis=0) for p in range(self.count)])


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """Orthonormal fixed columns, responses across them, and whether the stiffness is unity."""

    fixed: np.ndarray
    responses: np.ndarray
    mass_responses: np.ndarray
    sizes: np.ndarray
    mass_sizes: np.ndarray
    inside: np.ndarray
    unity: bool


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class AdaptiveModel:
    """Few coordinates that follow the parameters, within a space of candidates.

    Parameters
    ----------
    names
        Of the parameters.
    candidates
        Columns of W over the coordinates of the full model, orthonormal in A.
    stiffness, mass
        At zero parameters, over the candidates.
    stiffness_parts, mass_parts
        Parts by the parameters, over the candidates.
    fixed
        X and further vectors that every basis holds, over the candidates.
    responses
        :math:`A^{-1} K_p X` of each parameter.
    mass_responses
        :math:`A^{-1} M_p X` of each parameter.
    dofs
        What each degree of freedom of the full model is, before constraints.
    expansion
        Degrees of freedom before constraints, from those of the full matrices.
    error
        Found when the model was verified; None before.
    """

    names: tuple[str, ...]
    candidates: Float[np.ndarray, "own candidate"]
    stiffness: Float[np.ndarray, "candidate candidate"]
    mass: Float[np.ndarray, "candidate candidate"]
    stiffness_parts: FactoredParts
    mass_parts: FactoredParts
    fixed: Float[np.ndarray, "candidate fixed"]
    responses: Float[np.ndarray, "parameter candidate mode"]
    mass_responses: Float[np.ndarray, "parameter candidate mode"]
    dofs: DofMap | None = None
    expansion: sparse.csr_array | None = None
    error: ReductionError | None = None

    @property
    def size(self) -> int:
        """Number of coordinates at any parameters."""
        sets = 2 if self._weighs else 1
        count = self.fixed.shape[1] + sets * self.responses.shape[2]
        return int(min(count, len(self.mass)))

    @property
    def basis(self) -> Float[np.ndarray, "own candidate"]:
        """Coordinates of the full model from shapes that `modes` gives."""
        return self.candidates

    @functools.cached_property
    def _weighs(self) -> bool:
        return self.mass_parts.acts

    @functools.cached_property
    def _prepared(self) -> "_Prepared":
        """Products that do not depend on the parameters, made once."""
        fixed = np.linalg.qr(self.fixed)[0]
        unity = np.allclose(self.stiffness, np.eye(len(fixed)), atol=1e-8)
        across = _across(fixed, self.responses)
        responses = across.reshape(len(self.names), math.prod(across.shape[1:]))
        inside = self.stiffness_parts.columns.T @ fixed
        moved = _across(fixed, self.mass_responses)
        sizes = np.linalg.norm(across, axis=1), np.linalg.norm(moved, axis=1)
        return _Prepared(fixed, responses, moved, *sizes, inside, unity)

    @functools.cached_property
    def _dense(self) -> tuple[np.ndarray, np.ndarray]:
        """Parts of stiffness and mass as matrices, for slopes."""
        return self.stiffness_parts.dense(), self.mass_parts.dense()

    def sense(self, rows: Float[np.ndarray, "sensor dof"]) -> np.ndarray:
        """Sensor rows over the candidates, from rows over all degrees of freedom."""
        own = rows if self.expansion is None else rows @ self.expansion
        return np.asarray(own @ self.candidates)

    def coordinates(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> Float[np.ndarray, "candidate coordinate"]:
        """Orthonormal basis that belongs to values of the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].

        Returns
        -------
        One column for each coordinate, over the candidates.
        """
        ready = self._prepared
        factor = theta / np.maximum(1.0 + theta, 1.0 - LARGEST)
        response = (factor @ ready.responses).reshape(self.responses.shape[1:])
        response = _above_rounding(response, factor, ready.sizes)
        if self._weighs:
            moved = np.tensordot(theta, ready.mass_responses, 1)
            moved = _above_rounding(moved, theta, ready.mass_sizes)
            response = np.concatenate([response, moved], axis=1)
        gram = response.T @ response
        if not gram.any():
            return ready.fixed
        room = len(self.mass) - ready.fixed.shape[1]
        mixture = orthonormal_mixture(gram)[:, :room]
        return np.concatenate([ready.fixed, response @ mixture], axis=1)

    def at(
        self, theta: Float[np.ndarray, " parameter"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness, mass and basis at values of the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].

        Returns
        -------
        Stiffness and mass over the coordinates, and the coordinates over the candidates.
        """
        ready, basis = self._prepared, self.coordinates(theta)
        count, moving = ready.fixed.shape[1], basis[:, ready.fixed.shape[1] :]
        inside = np.empty((len(ready.inside), basis.shape[1]))
        inside[:, :count] = ready.inside
        inside[:, count:] = self.stiffness_parts.columns.T @ moving
        stiffness = inside.T @ (self.stiffness_parts.weights(theta)[:, None] * inside)
        if ready.unity:
            stiffness.flat[:: len(stiffness) + 1] += 1.0
        else:
            stiffness = stiffness + basis.T @ (self.stiffness @ basis)
        mass = basis.T @ (self.mass @ basis)
        if self._weighs:
            mass = mass + self.mass_parts.quadratic(theta, basis)
        return stiffness, mass, basis

    def modes(self, theta: Float[np.ndarray, " parameter"], count: int) -> ReducedModes:
        """Lowest modes at values of the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].
        count
            How many modes.

        Returns
        -------
        The modes, mass-normalised, over the candidates.
        """
        stiffness, mass, basis = self.at(theta)
        values, shapes = scipy.linalg.eigh(
            stiffness,
            mass,
            subset_by_index=(0, min(count, len(mass)) - 1),
            check_finite=False,
            overwrite_a=True,
            overwrite_b=True,
        )
        return ReducedModes(eigenvalue=values, shapes=basis @ shapes)

    def slopes(
        self,
        theta: Float[np.ndarray, " parameter"],
        rows: Float[np.ndarray, "sensor candidate"],
        count: int,
    ) -> tuple[ReducedModes, ModeSlopes]:
        """Lowest modes and their slopes by the parameters.

        Parameters
        ----------
        theta
            Relative changes of the parts [1].
        rows
            What each sensor sees of the candidates.
        count
            How many modes.

        Returns
        -------
        The modes over the candidates, and slopes of those modes.
        """
        found = self.modes(theta, int(np.ceil(SLOPE_MODES * count)))
        flat = self._dense[0].reshape(len(theta), self.stiffness.size)
        stiffness = self.stiffness + (theta @ flat).reshape(self.stiffness.shape)
        mass = self.mass
        if self._weighs:
            mass = mass + np.tensordot(theta, self._dense[1], 1)
        shift = (
            0.0 if found.eigenvalue[0] > 0.0 and self._prepared.unity else -found.eigenvalue[-1]
        )
        factor = scipy.linalg.cho_factor(stiffness - shift * mass, check_finite=False)
        solved = SolvedModel(
            eigenvalue=found.eigenvalue,
            shapes=found.shapes,
            stiffness_family=self.stiffness_parts,
            mass_family=self.mass_parts,
            weigh=mass.__matmul__,
            solve=lambda right: scipy.linalg.cho_solve(factor, right, check_finite=False),
            shift=shift,
        )
        return lowest_with_slopes(solved, rows, count)


def _across(fixed: np.ndarray, responses: np.ndarray) -> np.ndarray:
    """Part of responses orthogonal to the fixed columns, zero where it is rounding only."""
    left = responses - fixed @ (fixed.T @ responses)
    size, whole = np.linalg.norm(left, axis=1), np.linalg.norm(responses, axis=1)
    return np.ascontiguousarray(np.where((size > NOISE * whole)[:, None, :], left, 0.0))


def _above_rounding(response: np.ndarray, factor: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Columns of a weighted sum of responses, zero where the terms cancel but for rounding."""
    # They do where all parts change alike, as by temperature: the shapes stay. What rounding
    # leaves is no longer orthogonal to the fixed columns once it is scaled to unit length.
    kept = np.linalg.norm(response, axis=0) > NOISE * (np.abs(factor) @ sizes)
    return np.where(kept, response, 0.0)
