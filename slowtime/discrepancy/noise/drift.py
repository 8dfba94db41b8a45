r"""What an error of the force makes of a structure that nothing holds, to weigh its runs by.

Along a rigid motion without stiffness a free run adds up all errors of the force since it
began, and is as far off as it has run for: no reason to follow that drift to the last digit of
the sensor. To the noise of sensors of displacement and velocity,

.. math:: \sum_j |h_{sj}|^2 S_j , \qquad h_{sj} = (i \omega)^{n_s} \Phi_s
          (-\omega^2 M_r + i \omega C_r)^{-1} \Phi^T b_j

is therefore added, the density of what a white error of each input makes, :math:`S_j` being
that of `INPUT_ERROR` times what was recorded, over the band in which it lies.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.structure import Structure
from slowtime.dynamics.transfer import derivative_order
from slowtime.dynamics.units import unit_factor
from slowtime.signals.spectra import detrended, periodogram

INPUT_ERROR = 0.05
"""[standard deviations of the input] Error of a measured input: no gain of a drive and no
load cell in use is better known. Source: judgement on the calibration of drives and load
cells."""
BAND_POWER = 0.98
"""[share of power] Of an input that lies below the upper end of the band it drives. Source:
judgement; no study is recorded."""
RIGID_STIFFNESS = 1e-9
"""[share of the largest eigenvalue] Up to which a motion counts as rigid. Source: well above
rounding errors of the eigenvalues (1e-16), well below any vibration."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Drift:
    """Rigid motions of a structure that floats, and by how much its forces are in doubt.

    Parameters
    ----------
    mass, damping
        Of the rigid motions.
    shapes
        What each sensor reads of each, in its unit; zero for accelerations, which add up
        nothing.
    orders
        How often each sensor differentiates.
    participation
        What each input, in its unit, is to each of them.
    error_density
        By trial: density of the error of each input, in its unit.
    min_hz
        By trial: one over its length.
    """

    mass: Float[np.ndarray, "rigid rigid"]
    damping: Float[np.ndarray, "rigid rigid"]
    shapes: Float[np.ndarray, "sensor rigid"]
    orders: tuple[int, ...]
    participation: Float[np.ndarray, "rigid input"]
    error_density: tuple[Float[np.ndarray, " input"], ...]
    min_hz: tuple[float, ...]

    def transfer(
        self, trial: int, frequency_hz: Float[np.ndarray, " frequency"]
    ) -> Complex[np.ndarray, "frequency sensor input"]:
        """From an error of each input to what the sensors read."""
        held = np.where(frequency_hz > 0, frequency_hz, self.min_hz[trial])
        s = 2j * np.pi * held[:, None, None]
        inner = s**2 * self.mass + s * self.damping
        order = np.array(self.orders)[:, None]
        return np.asarray(
            s**order * (self.shapes @ np.linalg.solve(inner, self.participation[None]))
        )

    def density(
        self, trial: int, frequency_hz: Float[np.ndarray, " frequency"]
    ) -> Float[np.ndarray, "frequency sensor"]:
        """One-sided density of what each sensor reads of it."""
        return np.asarray(
            np.abs(self.transfer(trial, frequency_hz)) ** 2 @ self.error_density[trial]
        )

    def input_errors(
        self,
        trial: int,
        frequency_hz: Float[np.ndarray, " frequency"],
        residual: Complex[np.ndarray, "frequency sensor"],
        noise: Float[np.ndarray, "frequency sensor"],
    ) -> Complex[np.ndarray, "frequency input"]:
        """Errors of the inputs that a residual most probably comes from, beside the noise.

        None at 0 Hz: where what is left begins and ends at nothing, no constant made it.
        """
        along = self.transfer(trial, frequency_hz)
        loud = along * self.error_density[trial]
        both = loud @ along.conj().swapaxes(1, 2) + noise[:, :, None] * np.eye(noise.shape[1])
        seen = np.linalg.solve(both, residual[:, :, None])
        errors = (loud.conj().swapaxes(1, 2) @ seen)[:, :, 0]
        return np.asarray(np.where(frequency_hz[:, None] > 0, errors, 0.0))

    def first(self) -> "Drift":
        """Give that of the first trial alone."""
        return dataclasses.replace(
            self, error_density=self.error_density[:1], min_hz=self.min_hz[:1]
        )


def rigid_motions(structure: Structure) -> Float[np.ndarray, "dof rigid"]:
    """Motions that meet no stiffness, by mass.

    Examples
    --------
    >>> free = Structure(mass=4 * np.eye(1), damping=np.eye(1), stiffness=np.zeros((1, 1)))
    >>> rigid_motions(free)
    array([[0.5]])
    """
    value, vector = scipy.linalg.eigh(structure.stiffness, structure.mass)
    return np.asarray(vector[:, value <= RIGID_STIFFNESS * np.abs(value).max(initial=0.0)])


def has_rigid_motion(description: Description) -> bool:
    """Whether a structure has a motion that meets no stiffness."""
    return bool(rigid_motions(assemble(description)).shape[1])


def rigid_body_drift(description: Description, trials: Sequence[Trial]) -> Drift | None:
    """Drift of a structure that floats; None for one that is held."""
    structure = assemble(description)
    motions = rigid_motions(structure)
    if not motions.shape[1]:
        return None
    shapes = np.zeros((len(description.sensors), motions.shape[1]))
    orders = tuple(derivative_order(sensor.quantity) for sensor in description.sensors)
    coordinate = description.unit_of_coordinate
    for i, sensor in enumerate(description.sensors):
        if sensor.node in structure.names and orders[i] < 2:
            scale = unit_factor(sensor.unit, sensor.quantity, coordinate)
            shapes[i] = motions[structure.dof(sensor.node)] / scale
    return Drift(
        mass=motions.T @ structure.mass @ motions,
        damping=motions.T @ structure.damping @ motions,
        shapes=shapes,
        orders=orders,
        participation=_input_participation(description, structure, motions),
        error_density=tuple(_input_error_density(trial) for trial in trials),
        min_hz=tuple(1 / trial.duration_s for trial in trials),
    )


def _input_participation(
    description: Description, structure: Structure, motions: Float[np.ndarray, "dof rigid"]
) -> Float[np.ndarray, "rigid input"]:
    found = np.zeros((motions.shape[1], len(description.inputs)))
    for i, entry in enumerate(description.inputs):
        quantity: Literal["force", "acceleration"]
        quantity = "force" if entry.kind == "force" else "acceleration"
        scale = unit_factor(entry.unit, quantity, description.unit_of_coordinate)
        if entry.node is None:
            found[:, i] = scale * (motions.T @ structure.base_force(np.ones(1))[0])
        elif entry.node in structure.names:
            found[:, i] = scale * motions[structure.dof(entry.node)]
    return found


def _input_error_density(trial: Trial) -> Float[np.ndarray, " input"]:
    """Density of the error of each input, were it white in the band that is driven."""
    if not trial.inputs.shape[1]:
        return np.zeros(0)
    spectrum = periodogram(detrended(trial.inputs), trial.rate_hz)
    below = np.cumsum(spectrum.density, axis=0)
    top = np.argmax(below >= BAND_POWER * below[-1], axis=0)
    band = np.maximum(spectrum.frequency_hz[top], 1 / trial.duration_s)
    return np.asarray((INPUT_ERROR * trial.inputs.std(axis=0)) ** 2 / band)
