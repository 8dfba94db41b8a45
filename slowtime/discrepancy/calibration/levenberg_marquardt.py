"""Nonlinear least squares on the error of free runs by the Levenberg-Marquardt method."""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.time_limit import leave_out
from slowtime.dynamics.effects import Friction, Law
from slowtime.dynamics.plant import Plant

from .bounded_least_squares import solve_within
from .measured_friction import MeasuredFrictionPlant
from .prior import Prior
from .spectral_weights import SpectralWeights

CONVERGENCE = "convergence of fits"
"""What the time limit of a diagnosis leaves out of a fit, in words."""
MAX_STEPS = 20
"""[steps] Of one fit at most. Source: docs/what_decides.md: half and double change no
answer."""
MIN_GAIN = 0.02
"""[chi squared] Expected gain below which a step is not worth taking. Source: 0.02 moves a
parameter by a seventh of its standard deviation at most."""
RELATIVE_MIN_GAIN = 2e-5
"""[share of chi squared] The same where models are only compared. Source:
docs/decisions/0022; of 150,000 samples it is three."""
WRONG_MODEL_CHI2 = 3.0
"""[noise variances] Mean square from which a model is wrong rather than a little off. Source:
docs/what_decides.md: half and double change no answer."""
EXCESS_MIN_GAIN = 1e-3
"""[share of chi squared beyond noise] Expected gain below which a step is not worth taking.
Source: docs/decisions/0028."""
SLOW_GAIN = 1e-2
"""[share of chi squared beyond that of a wrong model] By which a step is slow: a wrong model
creeps along its valleys. Source: docs/decisions/0020."""
MAX_SLOW_STEPS = 2
"""[steps] Slow ones in a row that end a fit. Source: docs/decisions/0020."""
MIN_STEPS = 3
"""[steps] Before a fit may be called hopeless. Source: docs/what_decides.md: half and double
change no answer."""
HOPED_STEPS = 10.0
"""[steps] As large as the last one that a fit may still hope for. Source: docs/what_decides.md:
half and double change no answer."""
DAMPING_FACTOR = 4.0
"""[1] On the damping after a step in vain, doubled with each further one. Source: Nielsen
(1999) doubles in the same way."""
MIN_RAISED_DAMPING = 1e-5
"""[1] Damping of the scaled normal equations from which it is raised. Source:
docs/what_decides.md: half and double change no answer."""
MAX_DAMPING = 1e8
"""[1] Damping of the scaled normal equations from which no shorter step is tried. Source: steps
are then a hundred-millionth of the gradient."""
INITIAL_DAMPING = 1e-6
"""[1] Damping of the scaled normal equations at the start. Source: Nielsen (1999) recommends
1e-6 near a minimum."""
FULL_STEPS = 6
"""[steps] Undamped ones that are taken, up or down, before the cost is compared. Source:
docs/decisions/0022."""
CHAOTIC_GROWTH = 1e3
"""[1] Growth of the effect of an initial state over that of the record, from which motion
counts as chaotic. Source: docs/decisions/0031."""
FIRST_PARTS = 2.0 ** np.arange(-5, 1)
"""[share of the record] First parts from which that growth is measured. Source: halves of
halves, down to a thirty-second."""
INITIAL_STATE_SDS = 3.0
"""[root mean squares of the record] That one standard deviation of the prior of an initial
state explains. Source: a weak prior; docs/decisions/0031 on why it is there."""

State = Float[np.ndarray, " state"]
FreeConstants = Float[np.ndarray, " free"]


class FitAbandoned(Exception):
    """A fit was ended because it was late, or could not reach the cost to beat."""


@dataclasses.dataclass(frozen=True, slots=True)
class Comparison:
    """A cost that was compared with so many times its share of the cost to beat."""

    cost: float
    ratio: float
    data: tuple[int, int]

    def is_beaten(self, cost_to_beat: float | None) -> bool:
        """Whether it is more than that; never where there is no cost to beat."""
        if cost_to_beat is None:
            return False
        part, whole = self.data
        return self.cost > self.ratio * (cost_to_beat * part / whole)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class FitControl:
    """When a fit ends, and how far constants may move in it.

    Parameters
    ----------
    cost_to_beat
        Cost of another model: a fit ends where its steps have become too small to reach it, and
        is abandoned where the first part of the records is far from it.
    is_late
        Asked before each step; `FitAbandoned` is raised once it is true.
    keeps_best
        Whether a fit that is late ends at the best point so far instead.
    max_tolerances
        Tolerances by which constants of the structure may move at most.
    to_convergence
        Whether to step on until nothing is gained. That takes longer and changes parameters
        that the records hardly determine, but no comparison of models.
    data
        Samples that are fitted, and samples of whole records, whose cost is that to beat.
    compared
        Keeps what was compared with the cost to beat, where given.
    """

    cost_to_beat: float | None = None
    is_late: Callable[[], bool] | None = None
    keeps_best: bool = False
    max_tolerances: float = np.inf
    to_convergence: bool = False
    data: tuple[int, int] = (1, 1)
    compared: "list[Comparison] | None" = None

    def is_beaten(self, cost: float, ratio: float = 1.0) -> bool:
        """Whether a cost is more than so many times its share of the cost to beat."""
        comparison = Comparison(cost, ratio, self.data)
        if self.compared is not None:
            self.compared.append(comparison)
        return comparison.is_beaten(self.cost_to_beat)

    def has_ended(self) -> bool:
        """Whether it is late and the best so far is kept; raise `FitAbandoned` otherwise."""
        late = self.is_late is not None and self.is_late()
        if late and not self.keeps_best:
            raise FitAbandoned
        return late


DEFAULT_CONTROL = FitControl()


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LeastSquaresProblem:
    """Records, their weights, and the plant to fit to them.

    Parameters
    ----------
    samples
        Number of first samples of each trial that are fitted.
    friction_plants
        Of each trial, where friction acts along the measured motion.
    """

    plant: Plant
    prior: Prior
    trials: tuple[Trial, ...]
    weights: tuple[SpectralWeights, ...]
    samples: tuple[int, ...]
    friction_plants: tuple[MeasuredFrictionPlant, ...] = ()

    def plant_of_trial(self, number: int) -> Plant | MeasuredFrictionPlant:
        """Plant that simulates one trial."""
        return self.friction_plants[number] if self.friction_plants else self.plant


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Iterate:
    """Values of all constants, initial state of each trial (empty for rest), and their cost."""

    values: Float[np.ndarray, " parameter"]
    states: tuple[State, ...]
    cost: float = np.inf


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NormalEquations:
    """Normal equations at a point: free constants first, then the states of each trial."""

    cost: float
    matrix: Float[np.ndarray, "unknown unknown"]
    gradient: Float[np.ndarray, " unknown"]
    states: int

    @property
    def covariance(self) -> Float[np.ndarray, "unknown unknown"]:
        """Covariance of all unknowns: the inverse of the matrix."""
        scale = 1 / np.sqrt(np.maximum(np.diag(self.matrix), np.finfo(float).tiny))
        inner = self.matrix * np.outer(scale, scale)
        with np.errstate(over="ignore"):  # of what nothing tells
            return np.asarray(scipy.linalg.pinvh(inner) * np.outer(scale, scale))


def simulate_trial(
    problem: LeastSquaresProblem, number: int, point: Iterate
) -> Float[np.ndarray, "time sensor"]:
    """Simulate one trial from a point; outputs (time, sensor) in the sensors' units."""
    trial, count = problem.trials[number], problem.samples[number]
    return problem.plant_of_trial(number).simulate(
        point.values,
        trial.inputs[:count],
        trial.rate_hz,
        state0=point.states[number] if point.states[number].size else None,
        start_s=trial.start_s,
    )


def with_cost(
    problem: LeastSquaresProblem, point: Iterate, spread: tuple[State, ...]
) -> Iterate:
    """Compute chi squared of residuals and priors at a point; infinite where a run diverges."""
    free = point.values[list(problem.prior.index)]
    cost = problem.prior.cost(free)
    with np.errstate(all="ignore"):
        for number, (trial, weights) in enumerate(
            zip(problem.trials, problem.weights, strict=True)
        ):
            outputs = simulate_trial(problem, number, point)
            residual = trial.measured[: len(outputs)] - outputs
            cost += weights.chi2(residual)
            if point.states[number].size:
                cost += float(np.sum((point.states[number] / spread[number]) ** 2))
    return dataclasses.replace(point, cost=cost if np.isfinite(cost) else np.inf)


@np.errstate(all="ignore")  # non-finite results raise at the end
def normal_equations(
    problem: LeastSquaresProblem, point: Iterate, spread: tuple[State, ...] = ()
) -> tuple[NormalEquations, tuple[State, ...]]:
    """Linearise the residuals at a point.

    The standard deviations `spread` of each trial's initial state are chosen where none are
    given, and returned beside the equations.
    """
    prior, made = problem.prior, []
    cost = prior.cost(point.values[list(prior.index)])
    products: list[Float[np.ndarray, "column column"]] = []
    free = len(prior.names)
    acts = [problem.plant.kinds[effect.kind].action for effect in problem.plant.effects]
    bends = any(isinstance(action, Law | Friction) for action in acts)
    for number, (trial, weights) in enumerate(
        zip(problem.trials, problem.weights, strict=True)
    ):
        outputs, slopes = problem.plant_of_trial(number).sensitivities(
            point.values,
            trial.inputs[: problem.samples[number]],
            trial.rate_hz,
            prior.names,
            state0=point.states[number] if point.states[number].size else None,
            start_s=trial.start_s,
        )
        products.append(weights.products(trial.measured[: len(outputs)] - outputs, slopes))
        sizes = np.diag(products[-1])[free:-1]
        made.append(spread[number] if spread else _initial_state_sd(sizes, weights, trial))
        if bends and not spread:
            outrun = _sensitivity_growth(slopes[:, :, free:], trial.measured[: len(outputs)])
            made[-1] = np.where(outrun > CHAOTIC_GROWTH, outrun * made[-1], made[-1])
        cost += float(products[-1][-1, -1])
        if point.states[number].size:
            cost += float(np.sum((point.states[number] / made[-1]) ** 2))
    states = len(products[0]) - 1 - free
    size = free + states * len(products)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    for number, inner in enumerate(products):
        first = free + number * states
        where = np.r_[0:free, first : first + states]
        matrix[np.ix_(where, where)] += inner[:-1, :-1]
        gradient[where] += inner[:-1, -1]
        own = np.arange(first, first + states)
        matrix[own, own] += 1 / made[number] ** 2
        if point.states[number].size:
            gradient[own] -= point.states[number] / made[number] ** 2
    known = np.arange(free)
    matrix[known, known] += 1 / prior.sd**2
    gradient[known] += (prior.mean - point.values[list(prior.index)]) / prior.sd**2
    if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
        raise FloatingPointError(
            "The free-run simulation, or one of its derivatives, diverged."
        )
    return NormalEquations(cost=cost, matrix=matrix, gradient=gradient, states=states), tuple(
        made
    )


def minimise(
    problem: LeastSquaresProblem, start: Iterate, control: FitControl = DEFAULT_CONTROL
) -> tuple[Iterate, NormalEquations, tuple[State, ...]]:
    """Minimise the cost from a start by Levenberg's and Marquardt's method.

    Gives the best point with its cost, the normal equations there, or one step before where no
    more was gained, and the prior standard deviations of each trial's initial state.

    References
    ----------
    .. [1] J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and theory", Lecture
       Notes in Mathematics 630 (1978).
    .. [2] H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, Technical
       University of Denmark (1999).
    """
    normal, spread = normal_equations(problem, start)
    full = tuple(state if state.size else np.zeros(normal.states) for state in start.states)
    point = dataclasses.replace(start, states=full, cost=normal.cost)
    if control.to_convergence:
        point, normal = _full_steps(problem, point, normal, spread)
    damping, slow = INITIAL_DAMPING, 0
    data = sum(weights.data for weights in problem.weights)
    for number in range(MAX_STEPS):
        if control.has_ended() or leave_out(CONVERGENCE):
            break
        beyond = point.cost - WRONG_MODEL_CHI2 * data
        enough = MIN_GAIN
        if not control.to_convergence:
            enough += RELATIVE_MIN_GAIN * point.cost
            enough += EXCESS_MIN_GAIN * max(point.cost - data, 0.0)
        tried, gain, damping = _damped_step(problem, point, normal, spread, damping, enough)
        if not tried.cost < point.cost:
            break
        before, won, point = point, point.cost - tried.cost, tried
        slow = slow + 1 if won < SLOW_GAIN * beyond else 0
        hoped = point.cost - HOPED_STEPS * won
        hopeless = number >= MIN_STEPS and control.is_beaten(hoped)
        # Where no more was to be had, slopes are what they were.
        if max(won, gain) < enough or hopeless or slow == MAX_SLOW_STEPS:
            break
        try:
            normal, _ = normal_equations(problem, point, spread)
        except FloatingPointError:
            return before, normal, spread
        if won < enough:
            break
        # By how well the gain was foretold (Nielsen 1999): no more is lost on every other step.
        damping *= max(1 / 9, 1 - (2 * min(won / gain, 1.0) - 1) ** 3)
    return point, normal, spread


def _damped_step(
    problem: LeastSquaresProblem,
    point: Iterate,
    normal: NormalEquations,
    spread: tuple[State, ...],
    damping: float,
    enough: float,
) -> tuple[Iterate, float, float]:
    """Raise the damping until a step does not raise the cost, or is not worth taking."""
    bounds, raised = _step_bounds(problem, point), DAMPING_FACTOR
    while True:
        try:
            step, gain = _bounded_step(normal, damping, *bounds)
        # Equations that rounding left indefinite, as of many constants that are hardly told
        # apart, have a solution once they are damped.
        except np.linalg.LinAlgError:
            tried, gain = point, 0.0
            if damping > MAX_DAMPING:
                return tried, gain, damping
        else:
            tried = with_cost(problem, _apply_step(problem, point, step, normal.states), spread)
            ended = gain < enough or damping > MAX_DAMPING or leave_out(CONVERGENCE)
            if tried.cost <= point.cost or ended:
                return tried, gain, damping
        damping, raised = max(damping, MIN_RAISED_DAMPING) * raised, 2 * raised


def _full_steps(
    problem: LeastSquaresProblem,
    start: Iterate,
    normal: NormalEquations,
    spread: tuple[State, ...],
) -> tuple[Iterate, NormalEquations]:
    """Take undamped Gauss-Newton steps along a curved valley (nonmonotone search).

    References
    ----------
    .. [1] L. Grippo, F. Lampariello, S. Lucidi, "A nonmonotone line search technique for
       Newton's method", SIAM J. Numer. Anal. 23 (1986).
    """
    point, last = start, normal
    # Of two parameters that only their combination determines, such as a factor and a length
    # whose square divides it, one step raises the cost and the next corrects it. So the cost is
    # compared after a few of them.
    for _ in range(FULL_STEPS):
        if leave_out(CONVERGENCE):
            break
        try:
            step, gain = _bounded_step(last, 0.0, *_step_bounds(problem, point))
        except np.linalg.LinAlgError:
            return start, normal
        if gain < MIN_GAIN:
            break
        point = with_cost(problem, _apply_step(problem, point, step, last.states), spread)
        if not np.isfinite(point.cost):
            return start, normal
        try:
            last, _ = normal_equations(problem, point, spread)
        except FloatingPointError:
            return start, normal
    return (point, last) if point.cost < start.cost else (start, normal)


def _step_bounds(
    problem: LeastSquaresProblem, point: Iterate
) -> tuple[FreeConstants, FreeConstants]:
    """Bounds of a step: half way to a bound, and half of the scale or value."""
    prior = problem.prior
    here = point.values[list(prior.index)]
    far = np.maximum(prior.scale, np.abs(here)) / 2
    return np.maximum((prior.low - here) / 2, -far), np.minimum((prior.high - here) / 2, far)


def _bounded_step(
    normal: NormalEquations, damping: float, low: FreeConstants, high: FreeConstants
) -> tuple[Float[np.ndarray, " unknown"], float]:
    """Solve for the step within bounds of the constants; give it and its predicted gain."""
    diagonal = np.maximum(np.diag(normal.matrix), np.finfo(float).tiny)
    scale = 1 / np.sqrt(diagonal)
    inner = normal.matrix * np.outer(scale, scale)
    inner[np.diag_indices_from(inner)] += damping + 1e-12
    down = scale * normal.gradient
    least, most = (np.full(len(scale), far) for far in (-np.inf, np.inf))
    least[: len(low)], most[: len(high)] = low / scale[: len(low)], high / scale[: len(high)]
    # Where a bound is active, the others are solved for given that (bounded least squares).
    step = solve_within(inner, down, least, most)
    return np.asarray(scale * step), float(step @ (2 * down - inner @ step))


def _apply_step(
    problem: LeastSquaresProblem,
    point: Iterate,
    step: Float[np.ndarray, " unknown"],
    states: int,
) -> Iterate:
    prior, free = problem.prior, len(problem.prior.names)
    values = point.values.copy()
    values[list(prior.index)] += step[:free]
    parts = step[free:].reshape(-1, states) if states else [np.zeros(0)] * len(point.states)
    moved = tuple(old + new for old, new in zip(point.states, parts, strict=True))
    return Iterate(values=values, states=moved)


def _initial_state_sd(squares: State, weights: SpectralWeights, trial: Trial) -> State:
    """Choose a weak prior of the initial state: one sd explains the record several times."""
    size = np.sqrt(squares)
    whole = INITIAL_STATE_SDS * np.sqrt(weights.chi2(trial.measured[: len(weights.use)]))
    if whole == 0.0:
        return np.ones_like(size)  # a silent record does not determine them
    return np.asarray(whole / np.maximum(size, 1e-12 * size.max(initial=0.0) + 1e-300))


def _sensitivity_growth(
    slopes: Float[np.ndarray, "time sensor state"], measured: Float[np.ndarray, "time sensor"]
) -> State:
    """Growth of the sensitivity to initial states over the record, from any first part on."""
    # Where motion is chaotic, the sensitivity grows without bound, so that a prior made from
    # its end would fix the state; there the prior refers to a first part of the record. A
    # linear model that is unstable keeps its prior.
    parts = np.maximum((len(measured) * FIRST_PARTS).astype(int), MIN_SAMPLES)
    ends = np.unique(np.minimum(parts, len(measured))) - 1
    scale = np.std(measured, axis=0)
    scale[scale == 0.0] = 1.0
    heard = np.cumsum(np.sum((measured / scale) ** 2, axis=1))[ends]
    with np.errstate(all="ignore"):
        made = np.cumsum(np.sum((slopes / scale[:, None]) ** 2, axis=1), axis=0)[ends]
        beside = np.sqrt(heard[:, None] / np.maximum(made, np.finfo(float).tiny))
        return np.asarray(np.max(beside, axis=0) / beside[-1])
