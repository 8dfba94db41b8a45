r"""Pairs of points ranked by how likely something between them is missing, in closed form.

What joins two points resists their elongation :math:`b^T x`. A spring, a damper and a coupling
mass there (:math:`z = 1, i \omega, -\omega^2`) change the readings by the columns
:math:`c_z = g_b \, z \, b^T x`, where :math:`g_b` are the sensors' responses to a force along
:math:`b`. Constants and initial states are eliminated once (:math:`A` their normal matrix,
:math:`r` the residual at their optimum), so that a pair gains

.. math:: s^T (C - B A^{-1} B^T)^{-1} s \; \text{nats}, \qquad
          s_z = \Re \, c_z^H r , \; B_{zk} = \Re \, c_z^H w_k .

All products of :math:`c_z` are sums over few numbers for each point, so that hundreds of pairs
cost less than one fit. A law of any form has such a part in phase with elongation or rate
(equivalent linearisation).
"""

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import BASE

from .latent_force import RIDGE, LatentForceSolver
from .linear_response import LinearModel
from .perturbed_reference import PerturbedReference
from .ranking import linearise
from .spectral_lines import TrialLines

Pair = tuple[str, str]
ORDERS = 3
"""Spring, damper, mass."""
MIN_DISTINCT_SHARE = 1e-7
"""[share of a law's power] That constants must not reproduce, for the law to be told from
them. Source: square root of double precision, with margin."""


def likely_pairs(
    fit: Fit, trials: Sequence[Trial], pairs: Sequence[Pair], most: int
) -> list[Pair]:
    """Choose the pairs of points between which something is likeliest missing.

    One half gains most alone, and the other beside the best of these: where two things are
    missing, neighbours of the stronger one gain more than the weaker one does alone.

    Parameters
    ----------
    fit
        Of the reference.
    trials
        That it was fitted to.
    pairs
        Names of points: nodes, moved supports, or the base.
    most
        Pairs that are chosen.

    Returns
    -------
    The likeliest first.
    """
    solver, _, _ = linearise(fit, tuple(trials))
    screening = PairScreening(solver, pairs)
    alone = np.argsort(-screening.gains(), kind="stable").tolist()
    beside = np.argsort(-screening.gains(alone[0]), kind="stable").tolist()
    chosen = dict.fromkeys([*alone[: most - most // 2], *beside])
    return [pairs[i] for i in list(chosen)[:most]]


class PairScreening:
    """Products of what pairs of points may add with each other and with the residual.

    Parameters
    ----------
    solver
        The linearised reference, with its records.
    pairs
        Names of points.
    """

    def __init__(self, solver: LatentForceSolver, pairs: Sequence[Pair]) -> None:
        names = sorted({end for pair in pairs for end in pair})
        self._ends = np.array([[names.index(end) for end in pair] for pair in pairs])
        self._seen = [
            (_response_of(tuned, names), _motion_of(solver.linear, trial, names))
            for tuned, trial in zip(solver.tuned, solver.trials, strict=True)
        ]
        normal = _NormalEquations(solver)
        shape = len(pairs), ORDERS
        cross, slope = np.zeros((*shape, len(normal.scale))), np.zeros(shape)
        self._whole = np.zeros((*shape, ORDERS))
        for white, at, (response, motion) in zip(
            solver.white, normal.where, self._seen, strict=True
        ):
            along = _along_pairs(response, motion, white.columns, self._ends)
            cross[:, :, at] += along[:, :, :-1]
            slope += along[:, :, -1]
            self._whole += _own_products(response, motion, self._ends)
        self._cross = cross * normal.scale
        self._taken = scipy.linalg.cho_solve(
            normal.factor, self._cross.reshape(-1, cross.shape[2]).T
        ).T.reshape(cross.shape)
        self._slope = slope - self._cross @ normal.best
        self._rest = self._whole - np.einsum("pau,pbu->pab", self._cross, self._taken)

    def gains(self, beside: int | None = None) -> Float[np.ndarray, " pair"]:
        """Log likelihood [nats] that a spring, a damper and a mass together gain.

        Parameters
        ----------
        beside
            Number of a pair that has all three already.
        """
        slope, rest = self._slope, self._rest
        if beside is not None:
            both = self._products_with(beside)
            inverse = np.linalg.pinv(rest[beside], rcond=MIN_DISTINCT_SHARE, hermitian=True)
            slope = slope - both @ (inverse @ slope[beside])
            rest = rest - both @ inverse @ np.swapaxes(both, 1, 2)
        return _profile_gains(slope, rest, np.einsum("paa->pa", self._whole))

    def _products_with(self, number: int) -> Float[np.ndarray, "pair order order"]:
        """Products of all pairs with one of them, constants and initial states eliminated."""
        found = -np.einsum("pau,bu->pab", self._cross, self._taken[number])
        first, second = self._ends[number]
        for response, motion in self._seen:
            heard = response[:, :, second] - response[:, :, first]
            moved = (motion[:, :, second] - motion[:, :, first]).T
            columns = heard[:, :, None] * moved[:, None, :]
            found += _along_pairs(response, motion, columns, self._ends)
        return np.asarray(found)


class _NormalEquations:
    """Of constants, under their priors, and of initial states; scaled to a unit diagonal."""

    def __init__(self, solver: LatentForceSolver) -> None:
        constants = len(solver.known.sd)
        states = solver.white[0].columns.shape[2] - 1 - constants
        firsts = [constants + i * states for i in range(len(solver.trials))]
        self.where = [np.r_[0:constants, first : first + states] for first in firsts]
        size = firsts[-1] + states
        matrix, right = np.zeros((size, size)), np.zeros(size)
        for white, at in zip(solver.white, self.where, strict=True):
            matrix[np.ix_(at, at)] += white.inner[:-1, :-1]
            right[at] += white.inner[:-1, -1]
        known = np.arange(constants)
        # Densities of complex lines: half the chi squared of real numbers.
        matrix[known, known] += 0.5 / solver.known.sd**2
        right[known] -= 0.5 * solver.known.reference_change / solver.known.sd**2
        self.scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        scaled = matrix * np.outer(self.scale, self.scale) + RIDGE * np.eye(size)
        self.factor = scipy.linalg.cho_factor(scaled)
        self.best = scipy.linalg.cho_solve(self.factor, self.scale * right)


def _profile_gains(
    slope: Float[np.ndarray, "pair order"],
    rest: Float[np.ndarray, "pair order order"],
    whole: Float[np.ndarray, "pair order"],
) -> Float[np.ndarray, " pair"]:
    """Gain of each pair at its optimum; none of what constants can do as well."""
    own = np.einsum("paa->pa", rest)
    distinct = own > MIN_DISTINCT_SHARE * np.maximum(whole, np.finfo(float).tiny)
    size = np.sqrt(np.where(distinct, own, 1.0))
    unit = np.where(distinct, slope / size, 0.0)
    known = distinct[:, :, None] & distinct[:, None, :]
    like = np.where(known, rest / (size[:, :, None] * size[:, None, :]), 0.0)
    inverse = np.linalg.pinv(like, rcond=MIN_DISTINCT_SHARE, hermitian=True)
    return np.asarray(np.einsum("pa,pab,pb->p", unit, inverse, unit))


def _response_of(
    tuned: PerturbedReference, names: Sequence[str]
) -> Complex[np.ndarray, "frequency sensor point"]:
    """Whitened readings per unit force on each point."""
    sensed = tuned.sensed @ _directions(tuned.linear, names)
    return np.asarray(sensed / np.sqrt(tuned.trial.noise)[:, :, None])


def _directions(linear: LinearModel, names: Sequence[str]) -> Float[np.ndarray, "dof point"]:
    """Coordinate of each point; none of those that inputs move, or of the base."""
    found = np.zeros((linear.structure.dofs, len(names)))
    for number, name in enumerate(names):
        if name in linear.structure.names:
            found[linear.structure.dof(name), number] = 1.0
    return found


def _motion_of(
    linear: LinearModel, trial: TrialLines, names: Sequence[str]
) -> Complex[np.ndarray, "order frequency point"]:
    """Displacement, velocity and acceleration of each point against the base."""
    found = trial.motion @ _directions(linear, names)
    for number, name in enumerate(names):
        if name != BASE and trial.supports is not None and name in linear.description.moved:
            found[:, :, number] = trial.supports[:, :, linear.description.moved.index(name)]
    return np.asarray(found)


def _along_pairs(
    response: Complex[np.ndarray, "frequency sensor point"],
    motion: Complex[np.ndarray, "order frequency point"],
    columns: Complex[np.ndarray, "frequency sensor column"],
    ends: np.ndarray,
) -> Float[np.ndarray, "pair order column"]:
    """Real products of what spring, damper and mass of each pair add with columns."""
    orders, lines, points = motion.shape
    moved = np.ascontiguousarray(np.moveaxis(motion.conj(), 1, 2).reshape(-1, lines))
    found = np.zeros((len(ends), orders, columns.shape[2]))
    for point in range(points):
        pushed = response[:, :, point]
        if not pushed.any():
            continue
        heard = (pushed.conj()[:, None, :] @ columns)[:, 0]
        table = (moved @ heard).real.reshape(orders, points, -1)
        for side, other in ((1, 0), (0, 1)):
            own = ends[:, side] == point
            elongation = table[:, ends[own, side]] - table[:, ends[own, other]]
            found[own] += np.moveaxis(elongation, 0, 1)
    return found


def _own_products(
    response: Complex[np.ndarray, "frequency sensor point"],
    motion: Complex[np.ndarray, "order frequency point"],
    ends: np.ndarray,
) -> Float[np.ndarray, "pair order order"]:
    """Real products of what spring, damper and mass of each pair add with each other."""
    found = np.zeros((len(ends), len(motion), len(motion)))
    for number, (first, second) in enumerate(ends):
        power = np.sum(np.abs(response[:, :, second] - response[:, :, first]) ** 2, axis=1)
        moved = motion[:, :, second] - motion[:, :, first]
        found[number] = ((moved.conj() * power) @ moved.T).real
    return found
