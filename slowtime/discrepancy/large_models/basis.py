r"""Basis of a large model: modes within the band of the inputs, and static shapes.

.. math:: x = T q, \qquad T = (\Phi_{f \le f_b}, \; R), \qquad
          R = \Phi_h (\Lambda_h - \sigma)^{-1} \Phi_h^T P

:math:`R` are the residual shapes of unit forces on the points :math:`P` that are kept: what the
modes :math:`\Phi_h` that were left out add, exactly at one frequency in the band. Coordinates
are then mixed so that the first are the motions of these points.

References
----------
.. [1] R. R. Craig, A. J. Kurdila, "Fundamentals of Structural Dynamics", 2nd ed., Wiley
   (2006), ch. 17 (residual attachment modes).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.structure import Structure
from slowtime.signals.spectra import detrended

BAND_POWER = 0.999
"""[share of power] Of the inputs that lies in their band. Source: what is left is a thirtieth
in amplitude, and drives modes outside of the band at a resonance that is left out."""
MODE_MARGIN = 1.6
"""[1] Times the highest frequency of the band up to which modes are kept. Source: the
truncation error of a chain of 200 masses would add 50 to chi squared with 1.3, 7 with 1.5 and
nothing with 2, where every step takes twice as long."""
EXACT_AT = 0.7
"""[1] Times the highest frequency of the band, where residual shapes are exact. Source: the
middle of the squared frequencies of the band."""
MIN_INDEPENDENT = 1e-8
"""[1] Eigenvalue of the scaled Gram matrix of shapes below which one follows from the others.
Source: square root of double precision."""

Basis = Float[np.ndarray, "dof coordinate"]
Shapes = Float[np.ndarray, "dof shape"]


def band_limit_hz(trials: Sequence[Trial]) -> float:
    """Frequency [Hz] below which nearly all power of the inputs lies; 0 without any."""
    highest = 0.0
    for trial in trials:
        # Cosines continue a record as its mirror image. Periodic continuation would jump from
        # its end to its begin, and leak over all lines; a taper would hide a hit at the begin.
        spectrum = scipy.fft.dct(detrended(trial.inputs), axis=0) ** 2
        for power in spectrum.T:
            if power.any():
                below = np.cumsum(power) / power.sum()
                at = int(np.searchsorted(below, BAND_POWER))
                line = min(at, len(power) - 1)
                highest = max(highest, line * trial.rate_hz / (2 * len(power)))
    return highest


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandModes:
    """Undamped modes of a structure, and which of them are within the band of the inputs.

    Parameters
    ----------
    squares
        Squared circular frequencies [rad^2/s^2].
    exact_square
        Squared circular frequency at which residual shapes are exact.
    """

    structure: Structure
    squares: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "dof mode"]
    kept: int
    exact_square: float

    @classmethod
    def of(cls, structure: Structure, band_hz: float) -> "BandModes":
        """Find the modes of a structure, and those up to the margin above a band [Hz]."""
        squares, shapes = scipy.linalg.eigh(structure.stiffness, structure.mass)
        top = (2 * np.pi * band_hz) ** 2
        kept = int(np.searchsorted(squares, MODE_MARGIN**2 * top, side="right"))
        return cls(structure, squares, shapes, kept, EXACT_AT**2 * top)

    def basis(self, points: Sequence[str], loads: Shapes) -> Basis:
        """Make a basis whose first coordinates are the motions of some points.

        Of further forces on the coordinates (`loads`), residual shapes are kept.
        """
        rows = [self.structure.dof(name) for name in points]
        forces = np.hstack([np.eye(self.structure.dofs)[:, rows], loads])
        residual = _orthonormal(self.flexibility() @ forces, self.structure.mass)
        basis = np.hstack([self.shapes[:, : self.kept], residual])
        whole, upper = np.linalg.qr(basis[rows].T, mode="complete")
        count = len(rows)
        first = scipy.linalg.solve_triangular(upper[:count], whole[:, :count].T).T
        mixed = basis @ np.hstack([first, whole[:, count:]])
        mixed[rows] = np.eye(count, mixed.shape[1])
        return np.asarray(mixed)

    def flexibility(self) -> Float[np.ndarray, "dof dof"]:
        """Flexibility [m/N] of the modes that were left out."""
        rest = self.shapes[:, self.kept :]
        return np.asarray(rest / (self.squares[self.kept :] - self.exact_square) @ rest.T)


def _orthonormal(shapes: Shapes, mass: Float[np.ndarray, "dof dof"]) -> Shapes:
    """Make shapes orthonormal in the mass; those that follow from others are left out."""
    gram = shapes.T @ mass @ shapes
    size = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, mixture = np.linalg.eigh(gram * np.outer(size, size))
    own = values > MIN_INDEPENDENT
    return np.asarray((shapes * size) @ (mixture[:, own] / np.sqrt(values[own])))
