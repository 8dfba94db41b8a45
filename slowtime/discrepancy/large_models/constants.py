r"""Main directions of many constants: combinations that records tell from noise.

A constant of relative tolerance :math:`\tau` changes the readings by :math:`c_i \epsilon_i`,
with :math:`\epsilon_i \sim \mathcal{N}(0, 1)`. With whitened columns and
:math:`C^T C = Q \Lambda Q^T`, the combinations :math:`\eta = Q^T \epsilon` are as independent,
and :math:`\Lambda` is what each is expected to add to chi squared. Those that add next to
nothing are left at zero.

References
----------
.. [1] P. G. Constantine, "Active Subspaces", SIAM (2015), ch. 3.
"""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import DEFAULT_RELATIVE_SD
from slowtime.discrepancy.localization.latent_force import LatentForceSolver
from slowtime.discrepancy.localization.linear_response import parameter_matrices
from slowtime.dynamics.description import Description, assemble

from .basis import Basis

LEFT_CHI2 = 0.3
"""[chi squared] That all combinations left out are expected to add. Source: an effect has to
gain six nats; what a hundredth of that does not decide."""
CHUNK_LINES = 256
"""[lines] Whose columns are held at once. Source: a bound on memory, 20 MB of 400 constants and
12 sensors."""

ORDERS = {"stiffness": 0, "damping": 1, "mass": 2}
"""Derivative of the motion that each kind of constant multiplies."""

Constant = tuple[str, str]
"""Kind of the constant, and name of the element or node."""
Square = Float[np.ndarray, "constant constant"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Combinations of constants of one kind.

    Parameters
    ----------
    mixture
        Change of each constant in units of its tolerance, by direction; orthonormal.
    """

    constants: tuple[Constant, ...]
    mixture: Float[np.ndarray, "constant direction"]

    def changes(self, factors: Float[np.ndarray, " direction"]) -> dict[Constant, float]:
        """Relative change of each constant, given the factors (1 for none) of directions."""
        changed = self.mixture @ (factors - 1.0)
        return dict(zip(self.constants, changed.tolist(), strict=True))


def tolerances_of(description: Description) -> dict[str, float]:
    """Relative standard deviation of each kind of constant."""
    claimed = description.tolerance
    if claimed is None:
        return dict(DEFAULT_RELATIVE_SD)
    return {what: float(getattr(claimed, what)) for what in ORDERS}


def main_directions(
    solver: LatentForceSolver, basis: Basis, description: Description, kept: Collection[str]
) -> dict[str, Directions]:
    """Find the combinations of constants that records tell from noise, by kind of constant.

    Constants of the elements and nodes `kept` are left out.
    """
    parts = parameter_matrices(description)
    structure = assemble(description)
    influence = structure.influence
    found = {}
    for what, tolerance in tolerances_of(description).items():
        own = {name: part for name, part in parts.items() if name[0] == what}
        names = tuple(name for name in own if name[1] not in kept)
        if not names or not tolerance > 0:
            continue
        gram = np.zeros((len(names), len(names)))
        for tuned in solver.tuned:
            motion = tuned.trial.motion[ORDERS[what]] @ basis.T
            if what == "mass" and influence is not None:
                motion = motion + np.multiply.outer(tuned.trial.base, influence)
            seen = tuned.sensed / np.sqrt(tuned.trial.noise)[:, :, None]
            gram += _gram(motion, seen, basis, [own[name] for name in names])
        values, vectors = np.linalg.eigh(tolerance**2 * gram)
        telling = np.cumsum(values) > LEFT_CHI2
        found[what] = Directions(names, vectors[:, telling][:, ::-1])
    return found


def _gram(
    motion: Complex[np.ndarray, "frequency dof"],
    seen: Complex[np.ndarray, "frequency sensor coordinate"],
    basis: Basis,
    parts: Sequence[Float[np.ndarray, "dof dof"]],
) -> Square:
    """Real products of the readings that doubling each constant would add."""
    touched = [np.flatnonzero(part.any(axis=0)) for part in parts]
    own = [part[np.ix_(rows, rows)] for part, rows in zip(parts, touched, strict=True)]
    gram = np.zeros((len(parts), len(parts)))
    for first in range(0, len(motion), CHUNK_LINES):
        lines = slice(first, first + CHUNK_LINES)
        columns = np.empty((len(parts), motion[lines].shape[0] * seen.shape[1]), complex)
        for i, (part, rows) in enumerate(zip(own, touched, strict=True)):
            pull = -(motion[lines][:, rows] @ part.T) @ basis[rows]
            columns[i] = (seen[lines] @ pull[:, :, None]).ravel()
        both = columns.view(float)
        gram += 2 * both @ both.T
    return gram
