r"""Steady responses and free decays of a linear model, by its modes where they span all motion.

With the modes of the state, :math:`A = V \Lambda V^{-1}`, a line costs products with few
rows in place of an inverse:

.. math:: H(\omega) = V_q \, (i \omega - \Lambda)^{-1} \, V^{-1}
          \begin{pmatrix} 0 \\ M^{-1} \end{pmatrix} .
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

Force = Complex[np.ndarray, "frequency dof"]
Motion = Complex[np.ndarray, "order frequency dof"]
Readings = Complex[np.ndarray, "frequency sensor state"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StateModes:
    """Modes of the state (displacements, velocities) of a linear model.

    Poles are in rad/s; `pushed` are the modal coordinates that a unit force on each coordinate
    pushes.
    """

    poles: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "state mode"]
    back: Complex[np.ndarray, "mode state"]
    pushed: Complex[np.ndarray, "mode dof"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModalResponse:
    """Response as a sum of modes.

    Parameters
    ----------
    gains
        Modal coordinate per modal force, line by line [s].
    """

    shapes: Complex[np.ndarray, "dof mode"]
    gains: Complex[np.ndarray, "frequency mode"]
    pushed: Complex[np.ndarray, "mode dof"]

    def displacement(self, force: Force) -> Force:
        """Return the displacements [m] that forces [N] cause, line by line."""
        return np.asarray(((force @ self.pushed.T) * self.gains) @ self.shapes.T)

    def seen_by(
        self, rows: Float[np.ndarray, "sensor dof"]
    ) -> Complex[np.ndarray, "frequency sensor dof"]:
        """Return displacements along rows per unit force on each coordinate [m/N]."""
        return _weighted(rows @ self.shapes, self.gains, self.pushed)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DenseResponse:
    """Response as one matrix for each line [m/N]."""

    compliance: Complex[np.ndarray, "frequency dof dof"]

    def displacement(self, force: Force) -> Force:
        """Return the displacements [m] that forces [N] cause, line by line."""
        return np.asarray((self.compliance @ force[:, :, None])[:, :, 0])

    def seen_by(
        self, rows: Float[np.ndarray, "sensor dof"]
    ) -> Complex[np.ndarray, "frequency sensor dof"]:
        """Return displacements along rows per unit force on each coordinate [m/N]."""
        return np.asarray(rows @ self.compliance)


SteadyResponse = ModalResponse | DenseResponse
"""Steady displacement per force at the lines of a spectrum."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModalDecays:
    """Free decays as sums of modes.

    Parameters
    ----------
    gains
        Spectrum of each mode of unit amplitude.
    starts
        Modal coordinates of each unit initial state, less what is left at the end.
    """

    to_motion: Float[np.ndarray, "all state"]
    to_readings: Float[np.ndarray, "sensor state"]
    shapes: Complex[np.ndarray, "state mode"]
    gains: Complex[np.ndarray, "frequency mode"]
    starts: Complex[np.ndarray, "mode state"]

    @property
    def sensor_response(self) -> Readings:
        """Readings of the sensors (frequency, sensor, state)."""
        return _weighted(self.to_readings @ self.shapes, self.gains, self.starts)

    def moved(self, state: Float[np.ndarray, " state"]) -> Motion:
        """Displacement, velocity and acceleration of all coordinates from one initial state."""
        reached = (self.gains * (self.starts @ state)) @ self.shapes.T
        return _motion(self.to_motion, reached)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DenseDecays:
    """Free decays as one matrix for each line.

    Matrices lead from a state to motion and readings; `states` are by line and unit initial
    state.
    """

    to_motion: Float[np.ndarray, "all state"]
    to_readings: Float[np.ndarray, "sensor state"]
    states: Complex[np.ndarray, "frequency state state"]

    @property
    def sensor_response(self) -> Readings:
        """Readings of the sensors (frequency, sensor, state)."""
        return np.asarray(self.to_readings @ self.states)

    def moved(self, state: Float[np.ndarray, " state"]) -> Motion:
        """Displacement, velocity and acceleration of all coordinates from one initial state."""
        return _motion(self.to_motion, self.states @ state)


FreeDecaySpectra = ModalDecays | DenseDecays
"""Spectra of free decays from unit initial displacements and velocities."""


def _motion(
    to_motion: Float[np.ndarray, "all state"], states: Complex[np.ndarray, "frequency state"]
) -> Motion:
    motion = states @ to_motion.T
    return np.asarray(np.moveaxis(motion.reshape(len(states), 3, -1), 1, 0))


def _weighted(
    left: Complex[np.ndarray, "row mode"],
    gains: Complex[np.ndarray, "frequency mode"],
    right: Complex[np.ndarray, "mode column"],
) -> Complex[np.ndarray, "frequency row column"]:
    """Products left diag(gains) right, line by line, as one product of matrices."""
    weighted = (gains[:, None, :] * left[None]).reshape(-1, left.shape[1])
    return np.asarray((weighted @ right).reshape(len(gains), len(left), -1))
