r"""Likelihood and posterior of one unknown stationary force at one place.

.. math:: R_k = g_k w_k + X_k \theta + T_k \delta + n_k , \qquad
          w_k \sim \mathcal{N}_c(0, s_{b(k)}), \; n_k \sim \mathcal{N}_c(0, N_k) ,

with the constants :math:`\theta` (relative, under the model's tolerance) acting along the
motion with the force in it, so that a model that is far off is no obstacle; :math:`\delta` are
initial states, which also account for the circular transform. The variance :math:`s_b` of the
force in each band of each trial is found by Fisher scoring, constants by Gauss-Newton steps,
after each of which responses and residuals are computed anew. The variance of the posterior is
bounded by :data:`MAX_VARIANCE_RATIO`.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.discrepancy.linear_algebra import solve_semidefinite
from slowtime.dynamics.effects import Place
from slowtime.dynamics.work import count_work

from .linear_response import ForceSource, LinearModel
from .perturbed_reference import (
    Columns,
    Constants,
    LinearConstants,
    MotionSpectra,
    PerturbedReference,
)
from .spectral_lines import Lines, TrialLines

ROUNDS = 6
"""[1] Linearisations about the motion with the force in it, at most. Source:
docs/what_decides.md: half and double change no answer."""
SCORING_STEPS = 6
"""[steps] Of Fisher scoring for the variances of the force. Source: docs/what_decides.md: half
and double change no answer."""
MIN_GAIN = 0.5
"""[nats] Gain of log likelihood below which another round is not worth its while. Source:
half of chi squared's 1, one standard deviation."""
RELATIVE_MIN_GAIN = 1e-4
"""[share of the log likelihood] The same: of 100,000 readings, 10 nats. Source: places that are
told apart by so little in so many readings are not told apart by others of them."""
MAX_CONSTANT_STEP = 0.3
"""[1] Largest relative change of a constant in one round. Source: docs/what_decides.md: half
and double change no answer."""
RIDGE = 1e-9
"""[1] Added to the diagonal of the scaled normal equations. Source: well above double
precision, well below what a prior adds."""
MAX_VARIANCE_RATIO = 10.0
"""[1] Times the variance of a force in the band where it is sensed best that is accepted in
other bands: where sensors hardly sense the force, as accelerometers do at low frequency,
noise would be taken for force. Source: docs/decisions/0026."""
MAX_SQUARE = 1e100
"""[1] Sum of squares over the noise of a motion from which nothing can be estimated. Source:
far below the overflow of double precision."""
ROUNDING_SHARE = 1e-12
"""[share of a sum of squares] Which its difference from another as large cannot resolve.
Source: double precision, with margin for long sums."""

PRODUCT_WORK = 0.2
"""[units of work] Of a product of two numbers of columns, with all that is computed for it.
Source: processor times of linearisations of 4, 12 and 24 masses; without it, the budget of a
large model would not bound its time."""
MAX_TABLE = 20_000_000
"""[numbers] Products of columns with unit forces that are kept. Source: a bound on memory,
320 MB."""

PerLine = Float[np.ndarray, " frequency"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class WhitenedColumns:
    """Regressors and residual in units of the noise, and their inner products.

    Columns (frequency, sensor, column) are those of the constants, of free decays, and the
    residual.
    """

    columns: Columns
    inner: Float[np.ndarray, "column column"]

    @classmethod
    def of(
        cls,
        tuned: PerturbedReference,
        known: LinearConstants,
        motion: MotionSpectra,
        base: Complex[np.ndarray, " frequency"],
        residual: Lines,
    ) -> "WhitenedColumns":
        """Whiten the effects of constants along a motion, free decays and a residual."""
        constants = len(known.sd)
        both = np.empty((*residual.shape, constants + tuned.decays.shape[2] + 1), complex)
        both[:, :, :constants] = tuned.columns(known, motion, base)
        both[:, :, constants:-1] = tuned.decays
        both[:, :, -1] = residual
        both /= np.sqrt(tuned.trial.noise)[:, :, None]
        return cls(both, real_products(both.reshape(-1, both.shape[2])))


def real_products(
    columns: Complex[np.ndarray, "row column"],
) -> Float[np.ndarray, "column column"]:
    """Real parts of the inner products of complex columns; counted as work."""
    count_work(int(PRODUCT_WORK * len(columns) * columns.shape[1] ** 2))
    parts = np.ascontiguousarray(columns).view(float)
    both = parts.T @ parts
    return np.asarray(both[0::2, 0::2] + both[1::2, 1::2])


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrialForce:
    """Posterior of the force in one trial.

    Parameters
    ----------
    variance
        :math:`s` at each line.
    signal
        :math:`g^H N^{-1} g`: the force's signal-to-noise ratio per unit of variance.
    """

    variance: PerLine
    mean: Complex[np.ndarray, " frequency"]
    posterior_variance: PerLine
    linear: Lines
    left: Lines
    transfer: Lines
    signal: PerLine
    state: Float[np.ndarray, " state"]

    @property
    def unexplained(self) -> Lines:
        """Residual that the force does not explain either."""
        return np.asarray(self.left - self.transfer * self.mean[:, None])

    def noise_power(self) -> Float[np.ndarray, "frequency sensor"]:
        """Give the expected squared modulus of the noise, given the residuals."""
        doubt = np.abs(self.transfer) ** 2 * self.posterior_variance[:, None]
        return np.asarray(np.abs(self.unexplained) ** 2 + doubt)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explanation:
    """Force, constants and initial states of greatest likelihood for one place.

    Parameters
    ----------
    likelihood
        Log likelihood with constants and initial states at their maximum.
    linear
        The reference with its constants changed up to the last round, for the free decays.
    shifts
        Displacement, velocity and acceleration of all coordinates that force and constants add
        to the reference's run, without initial states; by trial.
    """

    source: ForceSource | None
    likelihood: float
    constants: Constants
    linear: LinearModel
    forces: tuple[TrialForce, ...]
    shifts: tuple[MotionSpectra, ...]


class LatentForceSolver:
    """Estimates an unknown force at one place after another, for the same residuals."""

    def __init__(
        self, linear: LinearModel, known: LinearConstants, trials: tuple[TrialLines, ...]
    ) -> None:
        self.linear, self.known, self.trials = linear, known, trials
        self.likelihoods: dict[tuple[Place, int], float] = {}
        """Of places, by rounds, as far as they were computed."""
        still = np.zeros(len(known.sd))
        self.tuned = [PerturbedReference.of(linear, trial, known, still) for trial in trials]
        self.white = [
            WhitenedColumns.of(tuned, known, trial.motion, trial.base, tuned.residual)
            for tuned, trial in zip(self.tuned, trials, strict=True)
        ]

    @functools.cached_property
    def tables(self) -> list[Complex[np.ndarray, "dof frequency column"]]:
        """Products of the columns with a unit force by coordinate; none if they are many."""
        # Before the first step they are the same for all places.
        size = sum(
            white.columns.size * len(self.linear.structure.names) for white in self.white
        )
        if size > MAX_TABLE * len(self.linear.description.sensors):
            return []
        return [
            np.moveaxis(
                np.swapaxes(tuned.sensed / np.sqrt(tuned.trial.noise)[:, :, None], 1, 2).conj()
                @ white.columns, 1, 0,
            )
            for tuned, white in zip(self.tuned, self.white, strict=True)
        ]  # fmt: skip

    def explain(self, source: ForceSource | None, *, rounds: int = ROUNDS) -> Explanation:
        """Find force, constants and initial states for one place, or for no force (None)."""
        return self.iterate(source, rounds=rounds).explained

    def iterate(self, source: ForceSource | None, *, rounds: int) -> "PlaceEstimate":
        """Maximise the likelihood of a force at one place; its posterior is lazy."""
        # The likeliest of all rounds is given; they end where the motion grows beyond bounds.
        place = _PlaceIteration(self, source)
        best = place.step()
        found = best
        for _ in range(rounds - 1):
            place.relinearise(found.explained)
            if not place.is_bounded:
                break
            found = place.step()
            gain = found.likelihood - best.likelihood
            if gain > 0:
                best = found
            if abs(gain) < max(MIN_GAIN, RELATIVE_MIN_GAIN * abs(best.likelihood)):
                break
        return best

    def solve(
        self,
        whites: list[WhitenedColumns],
        alongs: list[Complex[np.ndarray, "frequency column"]],
        signals: list[PerLine],
        variances: list[PerLine],
        change: Constants,
    ) -> tuple[Constants, list[Float[np.ndarray, " state"]], float]:
        """Solve for constants and initial states by least squares, given the force's variance.

        `alongs` are products of the whitened columns with a unit force, line by line. Gives the
        further change, the initial state of each trial, and the log likelihood.
        """
        constants = len(self.known.sd)
        states = whites[0].columns.shape[2] - 1 - constants
        size = constants + states * len(self.trials)
        matrix, right, total = np.zeros((size, size)), np.zeros(size), 0.0
        whole = np.zeros(size)
        for i, trial in enumerate(self.trials):
            rise = 1 + variances[i] * signals[i]
            # Woodbury: components along the force have less weight, by one product per line.
            heard = variances[i] > 0
            along = alongs[i][heard] * np.sqrt(variances[i] / rise)[heard, None]
            inner = whites[i].inner - real_products(along)
            where = np.r_[0:constants, constants + i * states : constants + (i + 1) * states]
            matrix[np.ix_(where, where)] += 2 * inner[:-1, :-1]
            right[where] += 2 * inner[:-1, -1]
            whole[where] += 2 * np.diag(whites[i].inner)[:-1]
            total -= inner[-1, -1] + float(trial.weight @ np.log(rise))
        known = np.arange(constants)
        off = (self.known.reference_change + change) / self.known.sd
        matrix[known, known] += 1 / self.known.sd**2
        right[known] -= off / self.known.sd
        total -= float(np.sum(off**2)) / 2
        # Where the force explains all of a column, rounding may leave a negative rest.
        matrix[np.diag_indices(size)] += np.maximum(
            ROUNDING_SHARE * whole - np.diag(matrix), 0.0
        )
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        inner = matrix * np.outer(scale, scale) + RIDGE * np.eye(size)
        found = scale * solve_semidefinite(inner, scale * right)
        total += float(right @ found) / 2
        return found[:constants], list(found[constants:].reshape(-1, states)), total


class PlaceEstimate:
    """Likelihood of a force at one place, and its posterior, computed on demand."""

    def __init__(self, likelihood: float, account: Callable[[], Explanation]) -> None:
        self.likelihood = likelihood
        self._account = account

    @functools.cached_property
    def explained(self) -> Explanation:
        """Force, constants and initial states."""
        return self._account()


class _PlaceIteration:
    """Iteration for one place: each step linearises where the last one ended."""

    def __init__(self, solver: LatentForceSolver, source: ForceSource | None) -> None:
        self.solver, self.source = solver, source
        self.change = np.zeros(len(solver.known.sd))
        self.tuned, self.white = solver.tuned, solver.white
        self.motions = [trial.motion for trial in solver.trials]
        self.bases = [trial.base for trial in solver.trials]
        self.states = [np.zeros(t.decays.shape[2]) for t in self.tuned]
        self.residuals = [tuned.residual for tuned in self.tuned]

    @property
    def is_bounded(self) -> bool:
        """Whether the motion is finite and small enough to linearise about."""
        return all((np.abs(white.inner) < MAX_SQUARE).all() for white in self.white)

    def step(self) -> PlaceEstimate:
        """Estimate the variance of the force, then constants and initial states."""
        trials, constants = self.solver.trials, len(self.change)
        roots = [np.sqrt(trial.noise) for trial in trials]
        transfers = [tuned.transfer(self.source) for tuned in self.tuned]
        units = [transfer / root for transfer, root in zip(transfers, roots, strict=True)]
        signals = [np.sum(np.abs(unit) ** 2, axis=1) for unit in units]
        alongs = self._alongs(units)
        further = np.zeros_like(self.change)
        likelihood = 0.0
        for _ in range(1 if self.source is None else 2):
            found = [np.concatenate([further, state]) for state in self.states]
            variances = [
                _band_variances(trial, along[:, -1] - along[:, :-1] @ taken, signal)
                for trial, along, taken, signal in zip(
                    trials, alongs, found, signals, strict=True
                )
            ]
            further, self.states, likelihood = self.solver.solve(
                self.white, alongs, signals, variances, self.change
            )
        states, residuals = self.states, self.residuals
        tuneds, whites, change = self.tuned, self.white, self.change

        def account() -> Explanation:
            numbers = range(len(trials))
            bent = [roots[i] * (whites[i].columns[:, :, :constants] @ further) for i in numbers]
            left = [residuals[i] - bent[i] - tuneds[i].decays @ states[i] for i in numbers]
            seen = [
                np.einsum("fs,fs->f", transfer.conj() / trial.noise, one)
                for transfer, trial, one in zip(transfers, trials, left, strict=True)
            ]
            believed = _capped_variances(trials, seen, signals, variances)
            forces = tuple(
                _force_posterior(
                    trials[i].residual - tuneds[i].residual + bent[i],
                    left[i],
                    seen[i],
                    transfers[i],
                    signals[i],
                    believed[i],
                    states[i],
                )
                for i in numbers
            )
            return Explanation(
                source=self.source,
                likelihood=likelihood,
                constants=change + further,
                linear=tuneds[0].linear,
                forces=forces,
                shifts=self._shifts(forces, further),
            )

        return PlaceEstimate(likelihood, account)

    def _alongs(self, units: list[Lines]) -> list[Complex[np.ndarray, "frequency column"]]:
        """Products of the columns with a whitened unit force, line by line."""
        source, tables = self.source, self.solver.tables
        read = source is None or source.sensor is not None or source.base
        if read or self.white is not self.solver.white or not tables:
            return [
                (unit.conj()[:, None, :] @ white.columns)[:, 0]
                for unit, white in zip(units, self.white, strict=True)
            ]
        assert source is not None
        rows = np.flatnonzero(source.force)
        return [(np.tensordot(source.force[rows], table[rows], 1)) for table in tables]

    def _shifts(
        self, forces: tuple[TrialForce, ...], further: Constants
    ) -> tuple[MotionSpectra, ...]:
        """Motion that force and constants add to that of the reference."""
        shifts = []
        for i, (tuned, force) in enumerate(zip(self.tuned, forces, strict=True)):
            pushed = np.zeros_like(tuned.shift)
            if self.source is not None:
                pushed = np.multiply.outer(force.mean, self.source.force)
            moved = tuned.motion_with(
                self.solver.known, further, self.motions[i], self.bases[i], pushed
            )
            shifts.append(moved - self.solver.trials[i].motion)
        return tuple(shifts)

    def relinearise(self, found: Explanation) -> None:
        """Linearise about the motion with the force in it and about the changed constants."""
        solver = self.solver
        stride = np.clip(found.constants - self.change, -MAX_CONSTANT_STEP, MAX_CONSTANT_STEP)
        for i, (trial, force) in enumerate(zip(solver.trials, found.forces, strict=True)):
            free = self.tuned[i].free.moved(force.state)
            self.motions[i] = trial.motion + found.shifts[i] + free
            if self.source is not None:
                self.bases[i] = trial.base + self.source.base * force.mean
        self.change = solver.known.within(self.change + stride)
        self.tuned = [
            PerturbedReference.of(solver.linear, trial, solver.known, self.change)
            for trial in solver.trials
        ]
        self.residuals = [
            _residual_with_gaps_filled(tuned, force)
            for tuned, force in zip(self.tuned, found.forces, strict=True)
        ]
        with np.errstate(over="ignore", invalid="ignore"):  # then it is not `is_bounded`
            self.white = [
                WhitenedColumns.of(tuned, solver.known, motion, base, residual)
                for tuned, motion, base, residual in zip(
                    self.tuned, self.motions, self.bases, self.residuals, strict=True
                )
            ]


def _residual_with_gaps_filled(tuned: PerturbedReference, force: TrialForce) -> Lines:
    """Residual with the estimate in place of samples that are not used."""
    if tuned.trial.gaps is None:
        return tuned.residual
    standing = force.linear + tuned.decays @ force.state
    return np.asarray(
        tuned.residual
        + tuned.trial.gap_spectrum(standing + force.transfer * force.mean[:, None])
    )


def _force_posterior(
    linear: Lines,
    left: Lines,
    seen: Complex[np.ndarray, " frequency"],
    transfer: Lines,
    signal: PerLine,
    variance: PerLine,
    state: Float[np.ndarray, " state"],
) -> TrialForce:
    """Posterior of the force, line by line."""
    spread = variance / (1 + variance * signal)
    return TrialForce(
        variance=variance,
        mean=spread * seen,
        posterior_variance=spread,
        linear=linear,
        left=left,
        transfer=transfer,
        signal=signal,
        state=state,
    )


def _band_variances(
    trial: TrialLines, seen: Complex[np.ndarray, " frequency"], signal: PerLine
) -> PerLine:
    """Maximum likelihood variance of the force in each band, by Fisher scoring."""
    heard = np.where(signal > 1e-12 * signal.max(initial=0.0), signal, 0.0)
    if not heard.any():
        return np.zeros(len(signal))
    power = np.abs(seen) ** 2 / np.where(signal > 0, signal, 1.0)
    lines = np.where(trial.weight < 1, 2 * power, power)
    variance = np.zeros(trial.bands)
    for _ in range(SCORING_STEPS):
        rise = 1 + variance[trial.band] * heard
        pull = heard / rise
        score = _sum_by_band(trial, trial.weight * pull * (lines / rise - 1))
        sharp = _sum_by_band(trial, trial.weight * pull**2)
        step = np.where(sharp > 0, score / np.where(sharp > 0, sharp, 1.0), 0.0)
        variance = np.maximum(variance + step, 0.0)
    return np.where(heard > 0, variance[trial.band], 0.0)


def _capped_variances(
    trials: Sequence[TrialLines],
    seen: Sequence[Complex[np.ndarray, " frequency"]],
    signals: Sequence[PerLine],
    variances: Sequence[PerLine],
) -> list[PerLine]:
    """Bound variances by a multiple of that in the band which determines the force best."""
    # That band is looked for in all trials: in one without any force it would be one of noise.
    best = 0.0, math.inf
    for trial, one, signal, variance in zip(trials, seen, signals, variances, strict=True):
        rise = 1 + variance * signal
        told = variance * np.abs(one) ** 2 / rise - np.log(rise)
        gain = _sum_by_band(trial, trial.weight * told)
        band = int(np.argmax(gain))
        loudest = float(variance[trial.band == band].max())
        best = max(best, (float(gain[band]), loudest))
    return [np.minimum(variance, MAX_VARIANCE_RATIO * best[1]) for variance in variances]


def _sum_by_band(trial: TrialLines, values: PerLine) -> Float[np.ndarray, " band"]:
    """Sum over the lines of each band."""
    return np.bincount(trial.band, values, minlength=trial.bands)
