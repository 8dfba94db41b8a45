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

Where resonances shift by more than their width, that is no measure. A link is a change of rank
one, so that the readings with it are known in closed form (Sherman and Morrison),

.. math:: c_z(\theta) = - \frac{\theta z \, b^T x}{1 + \theta z \, b^T H b} \, g_b ,

and the likeliest pairs are ranked by the profile likelihood of :math:`\theta`.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import BASE

from .latent_force import RIDGE, LatentForceSolver
from .linear_response import LinearModel
from .many_points import PointShapes, along_pairs, own_products
from .perturbed_reference import PerturbedReference
from .ranking import linearise
from .spectral_lines import TrialLines

NodePair = tuple[str, str]
"""Names of two points."""
ORDERS = 3
"""[derivatives] Spring, damper, mass. Source: the terms of an equation of motion."""
MOST_PROFILES = 60
"""[pairs] Likeliest by small changes that are ranked by changes of any size. Source: a bound
on computing time."""
SIZES = (1e-4, 30.0)
"""[1] Of a link, over the median of what resists its elongation. Source: from a hundredth
of a half-width of a resonance to what is rigid."""
PROFILE_POINTS = 64
"""[sizes] That are tried first. Source: steps of a fifth, a shift of resonances by a tenth."""
MIN_DISTINCT_SHARE = 1e-7
"""[share of a law's power] That constants must not reproduce, for the law to be told from
them. Source: square root of double precision, with margin."""


def likely_pairs(
    fit: Fit, trials: Sequence[Trial], pairs: Sequence[NodePair], most: int
) -> list[NodePair]:
    """Choose the pairs of points between which something is likeliest missing."""
    solver, _, _ = linearise(fit, tuple(trials))
    screening = PairScreening(solver, pairs)
    small = _falling(screening.gains())
    alone = _falling(screening.exact_gains(small[:MOST_PROFILES]))
    # Where two links are missing, neighbours of the stronger one gain more than the weaker one
    # does alone.
    beside = _falling(screening.gains(alone[0]))
    in_turn = itertools.chain.from_iterable(zip(alone, small, beside, strict=True))
    chosen = itertools.islice(dict.fromkeys(in_turn), most)
    return [pairs[i] for i in chosen]


def _falling(gains: Float[np.ndarray, " pair"]) -> list[int]:
    return list(np.argsort(-gains, kind="stable").tolist())


class PairScreening:
    """Products of what pairs of points may add with each other and with the residual."""

    def __init__(
        self,
        solver: LatentForceSolver,
        pairs: Sequence[NodePair],
        points: PointShapes | None = None,
    ) -> None:
        self._pairs, self._points = pairs, points
        names = sorted({end for pair in pairs for end in pair})
        self._ends = np.array([[names.index(end) for end in pair] for pair in pairs])
        along = self._along = _directions(solver.linear, names, points)
        self._seen = [
            (_response_of(tuned, along), _motion_of(solver.linear, trial, names, along))
            for tuned, trial in zip(solver.tuned, solver.trials, strict=True)
        ]
        normal = self._normal = _NormalEquations(solver)
        self._solver = solver
        shape = len(pairs), ORDERS
        cross, slope = np.zeros((*shape, len(normal.scale))), np.zeros(shape)
        self._whole = np.zeros((*shape, ORDERS))
        for tuned, white, at, (response, motion) in zip(
            solver.tuned, solver.white, normal.where, self._seen, strict=True
        ):
            if points is None:
                told = _along_pairs(response, motion, white.columns, self._ends)
                self._whole += _own_products(response, motion, self._ends)
            else:
                told = along_pairs(tuned, white.columns, along, self._ends)
                self._whole += own_products(response, motion, self._ends)
            cross[:, :, at] += told[:, :, :-1]
            slope += told[:, :, -1]
        self._cross = cross * normal.scale
        self._taken = scipy.linalg.cho_solve(
            normal.factor, self._cross.reshape(-1, cross.shape[2]).T
        ).T.reshape(cross.shape)
        self._slope = slope - self._cross @ normal.best
        self._rest = self._whole - np.einsum("pau,pbu->pab", self._cross, self._taken)

    def gains(self, beside: int | None = None) -> Float[np.ndarray, " pair"]:
        """Log likelihood [nats] that a spring, a damper and a mass together gain."""
        slope, rest = self._slope, self._rest
        if beside is not None:
            both = self._products_with(beside)
            inverse = np.linalg.pinv(rest[beside], rcond=MIN_DISTINCT_SHARE, hermitian=True)
            slope = slope - both @ (inverse @ slope[beside])
            rest = rest - both @ inverse @ np.swapaxes(both, 1, 2)
        return _profile_gains(slope, rest, np.einsum("paa->pa", self._whole))

    def exact_gains(self, among: Sequence[int]) -> Float[np.ndarray, " pair"]:
        """Log likelihood [nats] that a spring, a damper or a mass gains, of any size."""
        found = np.zeros(len(self._ends))
        for number in among:
            links = [self._link(number, i) for i in range(len(self._seen))]
            for order in range(ORDERS):
                found[number] = max(found[number], self._profile(links, order))
        return found

    def _profile(self, links: "list[_Link]", order: int) -> float:
        """Gain of one pair by the likeliest spring, damper or mass."""
        about = np.median(np.abs(links[0].compliance[:, order]))
        sizes = np.geomspace(*SIZES, PROFILE_POINTS) / max(about, np.finfo(float).tiny)
        bare = sum(link.bare_gains(sizes, order) for link in links)
        best = int(np.argmax(bare))
        few = np.geomspace(sizes[max(best - 1, 0)], sizes[min(best + 1, len(sizes) - 1)], 9)
        normal, gain = self._normal, np.zeros(len(few))
        cross = np.zeros((len(few), len(normal.scale)))
        for link, at in zip(links, normal.where, strict=True):
            gain += link.bare_gains(few, order)
            cross[:, at] += link.products(few, order)
        cross *= normal.scale
        taken = scipy.linalg.cho_solve(normal.factor, cross.T).T
        return float(np.max(gain + np.sum(cross * taken, axis=1)))

    def _link(self, number: int, trial: int) -> "_Link":
        """Response of one trial to what joins a pair."""
        response, motion = self._seen[trial]
        first, second = self._ends[number]
        heard = response[:, :, second] - response[:, :, first]
        along = self._along[:, second] - self._along[:, first]
        tuned, columns = self._solver.tuned[trial], self._solver.white[trial].columns
        best = self._normal.scale * self._normal.best
        columns = columns[:, :, :-1]
        left = (
            self._solver.white[trial].columns[:, :, -1]
            - columns @ best[self._normal.where[trial]]
        )
        s = 2j * np.pi * tuned.trial.frequency_hz[:, None]
        own = tuned.response.displacement(np.tile(along + 0j, (len(s), 1))) @ along
        if self._points is not None:
            own = own + self._points.along(*self._pairs[number])
        return _Link(
            (motion[:, :, second] - motion[:, :, first]).T,
            s ** np.arange(ORDERS) * own[:, None],
            np.sum(heard.conj() * left, axis=1),
            np.sum(np.abs(heard) ** 2, axis=1),
            (heard.conj()[:, None, :] @ columns)[:, 0],
        )

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


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Link:
    """What a link between two points changes in one trial.

    Parameters
    ----------
    compliance
        Elongation by a unit force that resists it, with its derivatives.
    seen, signal
        Products of the readings of a unit force with the residual and with themselves.
    """

    elongation: Complex[np.ndarray, "frequency order"]
    compliance: Complex[np.ndarray, "frequency order"]
    seen: Complex[np.ndarray, " frequency"]
    signal: Float[np.ndarray, " frequency"]
    along: Complex[np.ndarray, "frequency column"]

    def forces(
        self, sizes: Float[np.ndarray, " size"], order: int
    ) -> Complex[np.ndarray, "size frequency"]:
        """Force along the elongation, by the size of spring, damper or mass."""
        stiff = sizes[:, None] * self.elongation[:, order]
        return np.asarray(-stiff / (1 + sizes[:, None] * self.compliance[:, order]))

    def bare_gains(
        self, sizes: Float[np.ndarray, " size"], order: int
    ) -> Float[np.ndarray, " size"]:
        """Decrease of the whitened square, constants and initial states held."""
        force = self.forces(sizes, order)
        return np.asarray(
            2 * (force.conj() @ self.seen).real - np.abs(force) ** 2 @ self.signal
        )

    def products(
        self, sizes: Float[np.ndarray, " size"], order: int
    ) -> Float[np.ndarray, "size column"]:
        """Products of what is added with the columns of constants and initial states."""
        return np.asarray((self.forces(sizes, order).conj() @ self.along).real)


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
    tuned: PerturbedReference, directions: Float[np.ndarray, "dof point"]
) -> Complex[np.ndarray, "frequency sensor point"]:
    """Whitened readings per unit force on each point."""
    sensed = tuned.sensed @ directions
    return np.asarray(sensed / np.sqrt(tuned.trial.noise)[:, :, None])


def _directions(
    linear: LinearModel, names: Sequence[str], points: PointShapes | None = None
) -> Float[np.ndarray, "dof point"]:
    """Coordinates of each point; none of those that inputs move, or of the base."""
    found = np.zeros((linear.structure.dofs, len(names)))
    for number, name in enumerate(names):
        if points is not None and name in points.names:
            found[:, number] = points.shapes[points.names.index(name)]
        elif name in linear.structure.names:
            found[linear.structure.dof(name), number] = 1.0
    return found


def _motion_of(
    linear: LinearModel,
    trial: TrialLines,
    names: Sequence[str],
    directions: Float[np.ndarray, "dof point"],
) -> Complex[np.ndarray, "order frequency point"]:
    """Displacement, velocity and acceleration of each point against the base."""
    found = trial.motion @ directions
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
