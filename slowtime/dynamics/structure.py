r"""Structures of many degrees of freedom: :math:`M \ddot q + C \dot q + K q = f` (eq. 3.95)."""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Float

Square = Float[np.ndarray, "dof dof"]
ASYMMETRY = 1e-9
"""Relative asymmetry of a matrix above which it is taken for a mistake, not for rounding."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Structure:
    """Mass, damping and stiffness of a linear structure, in coordinates relative to its base.

    Parameters
    ----------
    mass, damping, stiffness
        Symmetric [kg], [N s/m], [N/m]; mass positive definite. With rotations among the
        coordinates, their rows and columns carry the units that go with them.
    names
        Of the degrees of freedom; numbers from 1 where none are given.
    influence
        What one metre of base motion moves each coordinate by, carried along rigidly; 1 for a
        translation along it, 0 for a rotation. None where base motion has no meaning.
    base_mass
        Column by which mass spread along elements couples the coordinates to the base; None
        for masses concentrated at the coordinates.
    gyroscopic
        Whether the damping may have a skew part, as couplings of rotating parts bring; modes,
        which are those of symmetric matrices, are not asked of such a structure.

    Examples
    --------
    >>> pair = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> Structure(mass=np.eye(2), damping=0.1 * pair, stiffness=pair).names
    ('1', '2')
    """

    mass: Square
    damping: Square
    stiffness: Square
    names: tuple[str, ...] = ()
    influence: Float[np.ndarray, " dof"] | None = None
    base_mass: Float[np.ndarray, " dof"] | None = None
    gyroscopic: bool = False

    def __post_init__(self) -> None:
        dofs = len(self.mass)
        if not self.names:
            object.__setattr__(self, "names", tuple(str(i + 1) for i in range(dofs)))
        if len(self.names) != dofs:
            raise ValueError(
                f"{len(self.names)} names were given for {dofs} degrees of freedom. Give one "
                "for each, or none."
            )
        for what in ("mass", "damping", "stiffness"):
            skew = self.gyroscopic and what == "damping"
            _check(what, getattr(self, what), dofs, skew=skew)
        try:
            scipy.linalg.cholesky(self.mass)
        except scipy.linalg.LinAlgError:
            raise ValueError(
                "The mass matrix is not positive definite: some degree of freedom has no mass. "
                "Give it one, or eliminate it statically."
            ) from None

    @property
    def dofs(self) -> int:
        """How many degrees of freedom there are."""
        return len(self.mass)

    def dof(self, name: str) -> int:
        """Index of a degree of freedom."""
        if name not in self.names:
            raise ValueError(
                f"No degree of freedom is called {name!r}. There are: {', '.join(self.names)}."
            )
        return self.names.index(name)

    def base_force(
        self, acceleration: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, "time dof"]:
        r"""Force equivalent to a base acceleration, :math:`-(M \iota + m_b) \, a_b`."""
        if self.influence is None:
            raise ValueError(
                "This structure does not say what base motion does to it. Give `influence`: 1 "
                "for each translation along the motion, 0 otherwise."
            )
        carried = self.mass @ self.influence
        if self.base_mass is not None:
            carried = carried + self.base_mass
        return np.asarray(np.multiply.outer(acceleration, -carried))


def state_matrix(structure: Structure) -> Float[np.ndarray, "state state"]:
    r"""Matrix :math:`A` of :math:`\dot x = A x + (0, M^{-1} f)`, :math:`x = (q, \dot q)`."""
    dofs = structure.dofs
    factor = scipy.linalg.cho_factor(structure.mass)
    below = np.hstack([structure.stiffness, structure.damping])
    above = np.eye(dofs, 2 * dofs, k=dofs)
    return np.vstack([above, -scipy.linalg.cho_solve(factor, below)])


def _check(
    what: str, matrix: Float[np.ndarray, "row column"], dofs: int, *, skew: bool
) -> None:
    if matrix.shape != (dofs, dofs):
        raise ValueError(
            f"The {what} matrix is {matrix.shape}, the mass matrix is {dofs} by {dofs}. Give "
            "square matrices of one size."
        )
    if not np.isfinite(matrix).all():
        raise ValueError(f"The {what} matrix holds NaN or infinity. Give finite numbers.")
    largest = np.abs(matrix).max(initial=0.0)
    if not skew and np.abs(matrix - matrix.T).max(initial=0.0) > ASYMMETRY * largest:
        raise ValueError(
            f"The {what} matrix is not symmetric. Check its entries; gyroscopic and "
            "circulatory forces are not part of this model."
        )
