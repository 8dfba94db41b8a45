r"""Drift of free runs along rigid-body motions, caused by errors of the measured inputs.

Along a motion without stiffness a free run integrates all errors of the force, and so drifts
away from the record. To the noise of sensors of displacement and velocity,

.. math:: \sum_j |h_{sj}|^2 S_j , \qquad h_{sj} = (i \omega)^{n_s} \Phi_s
          (-\omega^2 M_r + i \omega C_r)^{-1} \Phi^T b_j

is therefore added: the density of the response to a white error of each input. Its density
:math:`S_j` is that of `INPUT_ERROR` standard deviations over the band of the input.
"""

import dataclasses
from collections.abc import Sequence

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
"""[standard deviations of the input] Error of a measured input: no gain of a drive and no load
cell in use is better known. Source: the calibration of drives and load cells."""
BAND_POWER = 0.98
"""[share of power] Of an input that lies below the upper end of the band it drives. Source:
docs/what_decides.md: half and double change no answer."""
RIGID_STIFFNESS = 1e-9
"""[share of the largest eigenvalue] Up to which a motion counts as rigid. Source: well above
rounding errors of the eigenvalues (1e-16), well below any vibration."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Drift:
    """Rigid-body motions of a structure, and densities of the errors of its inputs.

    Parameters
    ----------
    shapes
        Reading of each sensor per unit of each motion, in its unit; zero for accelerations,
        which do not drift.
    participation
        Modal force per unit of each input.
    error_density
        By trial: one-sided density of the error of each input [unit²/Hz].
    min_hz
        By trial: one over its length [Hz], by which 0 Hz is replaced.
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
        """Frequency response from an error of each input to the sensors."""
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
        """One-sided density of the drift of each sensor in one trial [unit²/Hz]."""
        return np.asarray(
            np.abs(self.transfer(trial, frequency_hz)) ** 2 @ self.error_density[trial]
        )

    def input_errors(
        self,
        frequency_hz: Float[np.ndarray, " frequency"],
        residual: Complex[np.ndarray, "frequency sensor"],
        noise: Float[np.ndarray, "frequency sensor"],
    ) -> Complex[np.ndarray, "frequency input"]:
        """Spectrum of the input errors that cause a residual of the first trial (mean)."""
        along = self.transfer(0, frequency_hz)
        loud = along * self.error_density[0]
        both = loud @ along.conj().swapaxes(1, 2) + noise[:, :, None] * np.eye(noise.shape[1])
        seen = np.linalg.solve(both, residual[:, :, None])
        errors = (loud.conj().swapaxes(1, 2) @ seen)[:, :, 0]
        # A residual that begins and ends at zero has no constant cause.
        return np.asarray(np.where(frequency_hz[:, None] > 0, errors, 0.0))

    def first(self) -> "Drift":
        """Select the first trial."""
        return dataclasses.replace(
            self, error_density=self.error_density[:1], min_hz=self.min_hz[:1]
        )


def rigid_motions(structure: Structure) -> Float[np.ndarray, "dof rigid"]:
    """Rigid-body motions of a structure, normalised by mass.

    Examples
    --------
    >>> free = Structure(mass=4 * np.eye(1), damping=np.eye(1), stiffness=np.zeros((1, 1)))
    >>> rigid_motions(free)
    array([[0.5]])
    """
    value, vector = scipy.linalg.eigh(structure.stiffness, structure.mass)
    return np.asarray(vector[:, value <= RIGID_STIFFNESS * np.abs(value).max(initial=0.0)])


def has_rigid_motion(description: Description) -> bool:
    """Whether a structure has a rigid-body motion, one without stiffness."""
    return bool(rigid_motions(assemble(description)).shape[1])


def rigid_body_drift(description: Description, trials: Sequence[Trial]) -> Drift | None:
    """Describe the drift of a structure with rigid motions; None for one that is supported."""
    structure = assemble(description)
    motions = rigid_motions(structure)
    if not motions.shape[1]:
        return None
    shapes = np.zeros((len(description.sensors), motions.shape[1]))
    # A force follows from forces: it does not drift.
    orders = tuple(
        2 if sensor.quantity == "force" else derivative_order(sensor.quantity)
        for sensor in description.sensors
    )
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
    """Modal force of each rigid motion per unit of each input."""
    # Errors of a measured displacement or velocity are not integrated, and so count for
    # nothing.
    found = np.zeros((motions.shape[1], len(description.inputs)))
    for i, entry in enumerate(description.inputs):
        scale = unit_factor(entry.unit, entry.quantity, description.unit_of_coordinate)
        if entry.kind == "base_acceleration":
            found[:, i] = scale * (motions.T @ structure.base_force(np.ones(1))[0])
        elif entry.kind == "force" and entry.node in structure.names:
            found[:, i] = scale * motions[structure.dof(entry.node)]
    return found


def _input_error_density(trial: Trial) -> Float[np.ndarray, " input"]:
    """One-sided density of the error of each input, white over the band of the input."""
    if not trial.inputs.shape[1]:
        return np.zeros(0)
    spectrum = periodogram(detrended(trial.inputs), trial.rate_hz)
    below = np.cumsum(spectrum.density, axis=0)
    top = np.argmax(below >= BAND_POWER * below[-1], axis=0)
    band = np.maximum(spectrum.frequency_hz[top], 1 / trial.duration_s)
    return np.asarray((INPUT_ERROR * trial.inputs.std(axis=0)) ** 2 / band)
