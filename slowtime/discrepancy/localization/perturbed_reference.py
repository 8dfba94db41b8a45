"""The reference with changed constants: responses, free decays and residual."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .linear_response import ForceSource, LinearModel, parameter_matrices, support_columns
from .modal_spectra import FreeDecaySpectra, SteadyResponse
from .spectral_lines import Lines, TrialLines

MIN_CONSTANT_SHARE = 0.05
"""[share of a constant] That a change must leave. Source: docs/decisions/0021; a node keeps
a twentieth of its mass."""

FEW_COORDINATES = 4
"""[coordinates] That the matrix of a constant touches at most to be taken by itself. Source:
those of a beam; matrices over all coordinates are taken together."""

Columns = Complex[np.ndarray, "frequency sensor column"]
MotionSpectra = Complex[np.ndarray, "order frequency dof"]
Constants = Float[np.ndarray, " constant"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinearConstants:
    """Constants that may differ from the reference, with their priors.

    Parameters
    ----------
    matrices
        Contribution of each to stiffness, damping or mass; the last columns are of supports.
    reference_change
        Difference of the reference from nominal, relative to the reference.
    """

    matrices: Float[np.ndarray, "constant dof all"]
    orders: tuple[int, ...]
    reference_change: Constants
    sd: Constants

    @classmethod
    def of(
        cls,
        linear: LinearModel,
        names: tuple[tuple[str, str], ...],
        ahead: Constants,
        sd: Constants,
    ) -> "LinearConstants":
        """Read the matrices of constants, by their names in a plant, from the reference."""
        own = parameter_matrices(linear.description)
        order = {"stiffness": 0, "damping": 1, "mass": 2}
        dofs, seen = linear.structure.dofs, len(linear.description.dofs)
        ends = support_columns(linear.description)
        matrices = np.zeros((len(names), dofs, dofs + len(linear.description.moved)))
        for i, name in enumerate(names):
            if name in own:
                matrices[i, :seen, :seen] = own[name]
            if name in ends:
                matrices[i, :seen, dofs:] = ends[name]
        return cls(
            matrices=matrices,
            orders=tuple(order[name[0]] for name in names),
            reference_change=ahead,
            sd=sd,
        )

    def matrix_changes(self, change: Constants) -> Float[np.ndarray, "order dof all"]:
        """Sum the changes of stiffness, damping and mass."""
        found = np.zeros((3, *self.matrices.shape[1:]))
        for matrix, order, value in zip(self.matrices, self.orders, change, strict=True):
            found[order] += value * matrix
        return found

    def within(self, change: Constants) -> Constants:
        """Bound a relative change so that every constant keeps its sign."""
        return np.asarray(np.maximum(change, MIN_CONSTANT_SHARE - 1.0))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PerturbedReference:
    r"""Responses and residual of a trial with some constants changed.

    Parameters
    ----------
    free, decays
        Free decays, and their readings from each unit initial state.
    shift
        Displacement that the change adds: :math:`-H (\Delta K q + \Delta C \dot q
        + \Delta M \ddot q)`, with the new :math:`H` and the motion of the reference, which is
        exact but for initial states.
    residual
        Of the changed reference (frequency, sensor).
    """

    linear: LinearModel
    trial: TrialLines
    response: SteadyResponse
    sensed: Complex[np.ndarray, "frequency sensor dof"]
    decays: Complex[np.ndarray, "frequency sensor state"]
    free: FreeDecaySpectra
    shift: Complex[np.ndarray, "frequency dof"]
    residual: Lines

    @classmethod
    def of(
        cls,
        reference: LinearModel,
        trial: TrialLines,
        known: LinearConstants,
        change: Constants,
    ) -> "PerturbedReference":
        """Change the constants of the reference for one trial."""
        sums = known.matrix_changes(change)
        linear = reference.tuned(*sums[:, :, : reference.structure.dofs])
        modes = linear.state_modes()
        response = linear.steady_response(trial.frequency_hz, modes)
        sensed = linear.readings_of_rows(trial.frequency_hz, response.seen_by(linear.rows))
        free = linear.free_decay_spectra(
            trial.frequency_hz, trial.samples, trial.rate_hz, modes
        )
        inner = absolute_motion(linear, trial.motion, trial.base, trial.supports)
        pull = -sum(along @ matrix.T for along, matrix in zip(inner, sums, strict=True))
        shift = response.displacement(pull)
        return cls(
            linear=linear,
            trial=trial,
            response=response,
            sensed=sensed,
            decays=free.sensor_response,
            free=free,
            shift=shift,
            residual=trial.residual - (sensed @ pull[:, :, None])[:, :, 0],
        )

    def transfer(self, source: ForceSource | None) -> Lines:
        """Frequency response from a place to the sensors; zero without a place."""
        found = np.zeros(self.trial.noise.shape, dtype=complex)
        if source is None:
            return found
        if source.sensor is not None:
            found[:, source.sensor] = 1.0
            return found
        for row in np.flatnonzero(source.force):
            found += source.force[row] * self.sensed[:, :, row]
        if source.base:
            found += source.base * self.linear.base_response(self.trial.frequency_hz)
        return found

    def columns(
        self, known: LinearConstants, motion: MotionSpectra, base: np.ndarray
    ) -> Columns:
        """Give the readings that doubling each constant would add along a motion."""
        inner = absolute_motion(self.linear, motion, base, self.trial.supports)
        found = np.zeros((*self.sensed.shape[:2], len(known.sd)), dtype=complex)
        dense = [
            i
            for i, one in enumerate(known.matrices)
            if np.count_nonzero(one.any(axis=1)) > FEW_COORDINATES
        ]
        if dense:
            pulls = np.stack(
                [-inner[known.orders[i]] @ known.matrices[i].T for i in dense], axis=2
            )
            found[:, :, dense] = self.sensed @ pulls
        for i, (matrix, order) in enumerate(zip(known.matrices, known.orders, strict=True)):
            if i in dense:
                continue
            # Springs touch two coordinates only.
            rows, columns = (np.flatnonzero(matrix.any(axis=k)) for k in (1, 0))
            pull = -inner[order][:, columns] @ matrix[np.ix_(rows, columns)].T
            found[:, :, i] = (self.sensed[:, :, rows] @ pull[:, :, None])[:, :, 0]
        return found

    def motion_with(
        self,
        known: LinearConstants,
        change: Constants,
        motion: MotionSpectra,
        base: np.ndarray,
        force: Complex[np.ndarray, "frequency dof"],
    ) -> MotionSpectra:
        """Motion with a force and a further small change, without initial states."""
        inner = absolute_motion(self.linear, motion, base, self.trial.supports)
        sums = known.matrix_changes(change)
        pull = force - sum(along @ matrix.T for along, matrix in zip(inner, sums, strict=True))
        shift = self.shift + self.response.displacement(pull)
        s = 2j * np.pi * self.trial.frequency_hz[:, None]
        return np.asarray(self.trial.motion + np.stack([shift, s * shift, s**2 * shift]))


def absolute_motion(
    linear: LinearModel,
    motion: MotionSpectra,
    base: np.ndarray,
    supports: Complex[np.ndarray, "order frequency support"] | None = None,
) -> Complex[np.ndarray, "order frequency seen"]:
    """Motion that internal and inertial forces depend on: acceleration is absolute.

    The base's acceleration is in m/s^2; motion of supports is put behind that of the
    coordinates.
    """
    influence = linear.structure.influence
    if influence is not None:
        shaken = motion[2:] + np.multiply.outer(base, influence)
        motion = np.concatenate([motion[:2], shaken])
    return motion if supports is None else np.concatenate([motion, supports], axis=2)
