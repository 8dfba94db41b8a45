r"""One unknown stationary force at one place: how likely it makes residuals, and what it is.

.. math:: R_k = g_k w_k + X_k \theta + T_k \delta + n_k , \qquad
          w_k \sim \mathcal{N}_c(0, s_{b(k)}), \; n_k \sim \mathcal{N}_c(0, N_k) ,

with the constants :math:`\theta` (relative, under the model's tolerance) acting along the
motion that there was with the force in it, so that a model that is far off is no obstacle; with
:math:`\delta` for initial states and for the transform's being circular. The variance
:math:`s_b` of the force in each band of each trial is found by scoring, constants by Gauss's
and Newton's steps, after each of which responses and residuals are made anew.
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from .linear import Linear, Source
from .lines import Lines, TrialLines
from .tuned import Columns, Constants, Known, Moved, Tuned

ROUNDS, SCORINGS = 6, 6
ENOUGH = 0.5
"""Gain of log likelihood below which another round is not worth its while."""
STRIDE = 0.3
"""Largest change of a constant in one round."""
RIDGE = 1e-9

OfLine = Float[np.ndarray, " frequency"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Whitened:
    """Columns in units of the noise, and the products of them that no place changes.

    Parameters
    ----------
    columns
        Free decays first, the residual last.
    inner
        Real part of their products with each other.
    """

    columns: Columns
    inner: Float[np.ndarray, "column column"]

    @classmethod
    def of(cls, tuned: Tuned, residual: Lines) -> "Whitened":
        """Weigh decays and residual."""
        both = np.concatenate([tuned.decays, residual[:, :, None]], axis=2)
        both = both / np.sqrt(tuned.trial.noise)[:, :, None]
        return cls(both, _products(both, both))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrialForce:
    """The force in one trial.

    Parameters
    ----------
    variance
        :math:`s` at each line.
    mean, spread
        Posterior mean and variance of the force at each line.
    linear
        What changed constants explain, but for initial states.
    left
        What neither constants nor initial states explain.
    signal
        :math:`g^H N^{-1} g`: the force's signal-to-noise ratio per unit of variance.
    state
        Initial state added to the reference's.
    """

    variance: OfLine
    mean: Complex[np.ndarray, " frequency"]
    spread: OfLine
    linear: Lines
    left: Lines
    transfer: Lines
    signal: OfLine
    state: Float[np.ndarray, " state"]

    @property
    def unexplained(self) -> Lines:
        """What is left when the force is taken away too."""
        return np.asarray(self.left - self.transfer * self.mean[:, None])

    def noise_power(self) -> Float[np.ndarray, "frequency sensor"]:
        """Give the expected squared modulus of the noise, given the residuals."""
        doubt = np.abs(self.transfer) ** 2 * self.spread[:, None]
        return np.asarray(np.abs(self.unexplained) ** 2 + doubt)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explained:
    """How a place explains the residuals.

    Parameters
    ----------
    likelihood
        Log, with constants and initial states at their best.
    constants
        Relative change of each against the reference.
    linear
        The reference with its constants changed almost so: that of the free decays.
    shifts
        Displacement, velocity and acceleration of all coordinates that force and constants add
        to the reference's run, but for initial states; by trial.
    """

    source: Source | None
    likelihood: float
    constants: Constants
    linear: Linear
    forces: tuple[TrialForce, ...]
    shifts: tuple[Moved, ...]


class Solver:
    """Spectra and noise of all trials; asked for one place at a time."""

    def __init__(self, linear: Linear, known: Known, trials: tuple[TrialLines, ...]) -> None:
        self.linear, self.known, self.trials = linear, known, trials
        still = np.zeros(len(known.sd))
        self.tuned = [Tuned.of(linear, trial, known, still) for trial in trials]
        self.white = [Whitened.of(tuned, tuned.residual) for tuned in self.tuned]

    def explain(self, source: Source | None, *, rounds: int = ROUNDS) -> Explained:
        """Find force, constants and initial states for one place; None for no force at all.

        Of all rounds, the likeliest is given.
        """
        place = _Place(self, source)
        best = place.step()
        for _ in range(rounds - 1):
            found = place.step()
            gain = found.likelihood - best.likelihood
            if gain > 0:
                best = found
            if abs(gain) < ENOUGH:
                break
        return best

    def solve(
        self,
        columns: list[Columns],
        whites: list[Whitened],
        transfers: list[Lines],
        variances: list[OfLine],
        change: Constants,
    ) -> tuple[Constants, list[Float[np.ndarray, " state"]], float]:
        """Further change and initial states by least squares, given the force's variance."""
        constants, states = len(self.known.sd), whites[0].columns.shape[2] - 1
        size = constants + states * len(self.trials)
        matrix, right, total = np.zeros((size, size)), np.zeros(size), 0.0
        for i, trial in enumerate(self.trials):
            white = whites[i]
            whole = np.concatenate([columns[i], white.columns], axis=2)
            cross = _products(columns[i], whole)
            inner = np.block([[cross], [cross[:, constants:].T, white.inner]])
            unit = transfers[i] / np.sqrt(trial.noise)
            rise = 1 + variances[i] * np.sum(np.abs(unit) ** 2, axis=1)
            # Woodbury: what lies along the force counts less, by one product a line.
            along = (unit.conj()[:, None, :] @ whole)[:, 0]
            along = along * np.sqrt(variances[i] / rise)[:, None]
            inner = inner - (along.conj().T @ along).real
            where = np.r_[0:constants, constants + i * states : constants + (i + 1) * states]
            matrix[np.ix_(where, where)] += 2 * inner[:-1, :-1]
            right[where] += 2 * inner[:-1, -1]
            total -= inner[-1, -1] + float(trial.weight @ np.log(rise))
        known = np.arange(constants)
        off = (self.known.ahead + change) / self.known.sd
        matrix[known, known] += 1 / self.known.sd**2
        right[known] -= off / self.known.sd
        total -= float(np.sum(off**2)) / 2
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        inner = matrix * np.outer(scale, scale) + RIDGE * np.eye(size)
        found = scale * scipy.linalg.solve(inner, scale * right, assume_a="pos")
        total += float(right @ found) / 2
        return found[:constants], list(found[constants:].reshape(-1, states)), total


class _Place:
    """One place on its way to the likeliest force: each step starts where the last ended."""

    def __init__(self, solver: Solver, source: Source | None) -> None:
        self.solver, self.source = solver, source
        self.change = np.zeros(len(solver.known.sd))
        self.tuned, self.white = solver.tuned, solver.white
        self.motions = [trial.motion for trial in solver.trials]
        self.bases = [trial.base for trial in solver.trials]
        self.states = [np.zeros(t.decays.shape[2]) for t in self.tuned]
        self.filled: list[Lines] | None = None

    def step(self) -> Explained:
        """Variance of the force, then constants and states, then all that hangs on them."""
        solver, source = self.solver, self.source
        numbers = range(len(solver.trials))
        transfers = [tuned.transfer(source) for tuned in self.tuned]
        residuals = self.filled or [tuned.residual for tuned in self.tuned]
        left = [residuals[i] - self.tuned[i].decays @ self.states[i] for i in numbers]
        columns = [
            tuned.columns(solver.known, motion, base)
            for tuned, motion, base in zip(self.tuned, self.motions, self.bases, strict=True)
        ]
        further = np.zeros_like(self.change)
        likelihood = 0.0
        for _ in range(1 if source is None else 2):
            variances = [_variance(solver.trials[i], left[i], transfers[i]) for i in numbers]
            further, self.states, likelihood = solver.solve(
                columns, self.white, transfers, variances, self.change
            )
            bent = [np.sqrt(solver.trials[i].noise) * (columns[i] @ further) for i in numbers]
            left = [
                residuals[i] - bent[i] - self.tuned[i].decays @ self.states[i] for i in numbers
            ]
        forces = tuple(
            _force(
                self.tuned[i],
                solver.trials[i].residual - self.tuned[i].residual + bent[i],
                left[i],
                transfers[i],
                variances[i],
                self.states[i],
            )
            for i in numbers
        )
        shifts = self._move(forces, further)
        found = Explained(
            source=source,
            likelihood=likelihood,
            constants=self.change + further,
            linear=self.tuned[0].linear,
            forces=forces,
            shifts=shifts,
        )
        self._retune(forces, further)
        return found

    def _move(self, forces: tuple[TrialForce, ...], further: Constants) -> tuple[Moved, ...]:
        """Motion with the force in it; give what was added to the reference's."""
        shifts = []
        for i, (tuned, force) in enumerate(zip(self.tuned, forces, strict=True)):
            trial = self.solver.trials[i]
            pushed = np.zeros_like(tuned.shift)
            if self.source is not None:
                pushed = np.multiply.outer(force.mean, self.source.force)
            moved = tuned.moving(
                self.solver.known, further, self.motions[i], self.bases[i], pushed
            )
            shifts.append(moved - trial.motion)
            self.motions[i] = moved + tuned.moved @ self.states[i]
            if self.source is not None:
                self.bases[i] = trial.base + self.source.base * force.mean
        return tuple(shifts)

    def _retune(self, forces: tuple[TrialForce, ...], further: Constants) -> None:
        """Go to the changed constants, and fill in what was not measured."""
        solver = self.solver
        stride = np.clip(further, -STRIDE, STRIDE)
        self.change = solver.known.within(self.change + stride)
        gaps = any(trial.gaps is not None for trial in solver.trials)
        if not further.size and not gaps:
            return
        self.tuned = [
            Tuned.of(solver.linear, trial, solver.known, self.change) for trial in solver.trials
        ]
        if gaps:
            self.filled = [
                tuned.residual
                + trial.filling(
                    force.linear
                    + tuned.decays @ force.state
                    + force.transfer * force.mean[:, None]
                )
                for tuned, trial, force in zip(self.tuned, solver.trials, forces, strict=True)
            ]
        residuals = self.filled or [tuned.residual for tuned in self.tuned]
        self.white = [
            Whitened.of(tuned, residual)
            for tuned, residual in zip(self.tuned, residuals, strict=True)
        ]


def _force(
    tuned: Tuned,
    linear: Lines,
    left: Lines,
    transfer: Lines,
    variance: OfLine,
    state: Float[np.ndarray, " state"],
) -> TrialForce:
    """Posterior of the force, line by line."""
    trial = tuned.trial
    signal, _ = _along(trial, left, transfer)
    spread = variance / (1 + variance * signal)
    mean = spread * np.einsum("fs,fs->f", transfer.conj() / trial.noise, left)
    return TrialForce(
        variance=variance,
        mean=mean,
        spread=spread,
        linear=linear,
        left=left,
        transfer=transfer,
        signal=signal,
        state=state,
    )


def _variance(trial: TrialLines, left: Lines, transfer: Lines) -> OfLine:
    """Variance of the force in each band, of greatest likelihood given what is left."""
    signal, power = _along(trial, left, transfer)
    heard = np.where(signal > 1e-12 * signal.max(initial=0.0), signal, 0.0)
    if not heard.any():
        return np.zeros(len(signal))
    lines = np.where(trial.weight < 1, 2 * power, power)
    variance = np.zeros(trial.bands)
    for _ in range(SCORINGS):
        rise = 1 + variance[trial.band] * heard
        pull = heard / rise
        score = _sum(trial, trial.weight * pull * (lines / rise - 1))
        sharp = _sum(trial, trial.weight * pull**2)
        step = np.where(sharp > 0, score / np.where(sharp > 0, sharp, 1.0), 0.0)
        variance = np.maximum(variance + step, 0.0)
    return np.where(heard > 0, variance[trial.band], 0.0)


def _along(trial: TrialLines, left: Lines, transfer: Lines) -> tuple[OfLine, OfLine]:
    """Signal-to-noise ratio of a unit force, and power of what is left in its direction."""
    weighted = transfer.conj() / trial.noise
    signal = np.einsum("fs,fs->f", weighted, transfer).real
    seen = np.einsum("fs,fs->f", weighted, left)
    power = np.abs(seen) ** 2 / np.where(signal > 0, signal, 1.0)
    return signal, power


def _products(
    one: Columns, other: Complex[np.ndarray, "frequency sensor other"]
) -> Float[np.ndarray, "column other"]:
    """Real part of the products of columns, over all lines and sensors."""
    first, second = one.reshape(-1, one.shape[2]), other.reshape(-1, other.shape[2])
    return np.asarray(first.real.T @ second.real + first.imag.T @ second.imag)


def _sum(trial: TrialLines, values: OfLine) -> Float[np.ndarray, " band"]:
    return np.bincount(trial.band, values, minlength=trial.bands)
