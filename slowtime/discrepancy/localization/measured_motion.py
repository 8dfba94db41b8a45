r"""Motion that the sensors tell by themselves, where there is one for each coordinate.

With an unknown force :math:`w` on every coordinate at once,

.. math:: R_k = H_k w_k + T_k \delta + n_k , \quad
          w_k \sim \mathcal{N}_c(0, \mathrm{diag}\,s_{b(k)}), n_k \sim \mathcal{N}_c(0, N_k) ,

the posterior motion needs no assumption about what is missing, and where: laws at different
places are compared along one motion. The variances :math:`s_b` of each band are found by
expectation maximisation, the initial states :math:`\delta` by generalised least squares.

References
----------
.. [1] A. P. Dempster, N. M. Laird, D. B. Rubin, "Maximum likelihood from incomplete data via
   the EM algorithm", J. R. Stat. Soc. B 39 (1977).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial

from .latent_force import RIDGE, Explanation, LatentForceSolver, TrialForce
from .linear_response import ForceSource
from .perturbed_reference import MotionSpectra, PerturbedReference
from .places import Localization, PlaceGroup
from .ranking import linear_names, linearise

EM_STEPS = 12
"""[steps] Of expectation maximisation. Source: variances are only weights where sensors hear
the forces well."""

MIN_SIGNAL_SHARE = 1e-12
"""[share of the greatest response] Up to which a force is not heard, as by accelerometers at 0.
Source: as for the force at one place (`latent_force`)."""

DofForces = Complex[np.ndarray, "frequency dof"]


def measured_motion(fit: Fit, trials: Sequence[Trial]) -> Localization | None:
    """Recover the motion with a force on every coordinate, and the force at each place alone.

    Every place of the structure, its sensors and inputs is a group of its own, all with the
    same motion. None where sensors are fewer than coordinates, or samples are missing.
    """
    records = tuple(trials)
    if not all(trial.used.all() for trial in records):
        return None
    solver, runs, outer = linearise(fit, records)
    if np.linalg.matrix_rank(solver.linear.rows) < solver.linear.structure.dofs:
        return None
    recovered = [_forces(tuned) for tuned in solver.tuned]
    if not all(np.isfinite(force).all() for force, _ in recovered):
        return None
    shifts = tuple(
        _shift(tuned, force) for tuned, (force, _) in zip(solver.tuned, recovered, strict=True)
    )
    names = linear_names(fit)
    still = {name: 0.0 for _, name in names}
    groups = [
        PlaceGroup(
            places=(source.place,), score=0.0, p_value=1.0, share=0.0, left=1.0,
            constants=still, explained=_explanation(solver, source, recovered, shifts),
            twins=(),
        )
        for source in solver.linear.sources()
    ]  # fmt: skip
    return Localization(
        groups=tuple(groups), linear=solver.linear, trials=records, lines=solver.trials,
        runs=runs, outer=outer, outputs=fit.outputs,
        nominal={name: float(fit.prior.mean[i]) for i, name in names},
        tolerance={name: float(fit.prior.sd[i]) for i, name in names},
        log_likelihood=0.0,
    )  # fmt: skip


def _forces(tuned: PerturbedReference) -> tuple[DofForces, Float[np.ndarray, " state"]]:
    """Posterior mean of the force on each coordinate, and the initial state, in one trial."""
    trial = tuned.trial
    root = np.sqrt(trial.noise)
    heard = tuned.sensed / root[:, :, None]
    residual, decays = tuned.residual / root, tuned.decays / root[:, :, None]
    dofs = heard.shape[2]
    count = np.bincount(trial.band, trial.weight, minlength=trial.bands)

    def by_band(power: Float[np.ndarray, "frequency dof"]) -> Float[np.ndarray, "band dof"]:
        weighted = trial.weight[:, None] * power
        sums = [np.bincount(trial.band, one, minlength=trial.bands) for one in weighted.T]
        return np.stack(sums, axis=1) / count[:, None]

    signal = np.sum(np.abs(heard) ** 2, axis=1)
    told = signal > MIN_SIGNAL_SHARE * signal.max(axis=0)
    power = np.sum(np.abs(residual) ** 2, axis=1)[:, None] / np.where(told, signal, np.inf)
    variance = by_band(power / dofs)
    adjoint = np.conj(np.swapaxes(heard, 1, 2))
    force, state = np.zeros(heard.shape[::2], dtype=complex), np.zeros(decays.shape[2])
    for _ in range(EM_STEPS):
        spread = variance[trial.band]
        covariance = (heard * spread[:, None, :]) @ adjoint + np.eye(heard.shape[1])
        inverse = np.linalg.inv(covariance)
        state = _state(decays, residual, inverse, trial.weight)
        gain = spread[:, :, None] * (adjoint @ inverse)
        force = (gain @ (residual - decays @ state)[:, :, None])[:, :, 0]
        explained = np.einsum("fds,fsd->fd", gain, heard).real
        variance = by_band(np.abs(force) ** 2 + spread * np.maximum(1 - explained, 0.0))
    return force, state


def _state(
    decays: Complex[np.ndarray, "frequency sensor state"],
    residual: Complex[np.ndarray, "frequency sensor"],
    inverse: Complex[np.ndarray, "frequency sensor sensor"],
    weight: Float[np.ndarray, " frequency"],
) -> Float[np.ndarray, " state"]:
    """Solve for the initial state by generalised least squares."""
    white = weight[:, None, None] * (inverse @ decays)
    matrix = np.einsum("fsa,fsb->ab", decays.conj(), white).real
    right = np.einsum("fsa,fs->a", white.conj(), residual).real
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    inner = matrix * np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    return np.asarray(scale * np.linalg.solve(inner, scale * right))


def _shift(tuned: PerturbedReference, force: DofForces) -> MotionSpectra:
    """Motion that forces add to that of the reference."""
    moved = tuned.shift + tuned.response.displacement(force)
    s = 2j * np.pi * tuned.trial.frequency_hz[:, None]
    return np.stack([moved, s * moved, s**2 * moved])


def _explanation(
    solver: LatentForceSolver,
    source: ForceSource,
    recovered: Sequence[tuple[DofForces, Float[np.ndarray, " state"]]],
    shifts: tuple[MotionSpectra, ...],
) -> Explanation:
    """Force at one place that alone explains most, beside the motion of all forces."""
    forces = []
    for tuned, (force, state) in zip(solver.tuned, recovered, strict=True):
        transfer = tuned.transfer(source)
        left = tuned.residual - tuned.decays @ state
        signal = np.sum(np.abs(transfer) ** 2 / tuned.trial.noise, axis=1)
        seen = np.sum(transfer.conj() * left / tuned.trial.noise, axis=1)
        heard = signal > MIN_SIGNAL_SHARE * signal.max()
        spread = np.where(heard, 1 / np.where(heard, signal, 1.0), 0.0)
        forces.append(
            TrialForce(
                variance=np.full(len(signal), np.inf),
                # The base moves as it was measured: a force of its own would move it anew.
                mean=np.zeros_like(seen) if source.base else spread * seen,
                posterior_variance=spread,
                linear=(tuned.sensed @ force[:, :, None])[:, :, 0],
                left=left,
                transfer=transfer,
                signal=signal,
                state=state,
            )
        )
    return Explanation(
        source=source,
        likelihood=0.0,
        constants=np.zeros(len(solver.known.sd)),
        linear=solver.tuned[0].linear,
        forces=tuple(forces),
        shifts=shifts,
    )
