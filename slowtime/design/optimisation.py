r"""Reliability-based robust design: eq. (4.18) under accepted probabilities of failure.

Sequential optimisation and reliability assessment: a deterministic programme with the inputs
at their worst points, then new worst points at the design found, until neither moves. The
probabilities of failure are then verified by sampling, and the distance of the worst points is
corrected by what the first-order approximation missed.

References
----------
.. [1] X. Du and W. Chen, "Sequential optimization and reliability assessment method for
   efficient probabilistic design", J. Mech. Des. 126 (2004) 225-233.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from slowtime.reliability import estimate

from .inverse_form import worst_points
from .objective import COARSE, RobustObjective
from .problem import DesignProblem, Function, values_of
from .result import Design, Evaluated, Verified
from .subproblem import Programme, solve

ROUNDS = 12
"""Alternations with one distance of the worst points, at most."""

CORRECTIONS = 8
"""Corrections of that distance, at most."""

STILL = 1e-4
"""Move of a design, over the width of the bounds, below which it has settled."""

CLOSE = 0.01
"""Error of the reliability index below which its correction ends: 3 % of a probability of
0.001."""

ACTIVE = 1e-3
"""Limit state over its spread, below which a constraint holds the design where it is."""

Say = Callable[[str], None]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How carefully probabilities are verified.

    Parameters
    ----------
    method
        Of `slowtime.reliability.METHODS`, one with an interval.
    variation
        Coefficient of variation of a verified probability.
    calls
        Calls of a limit state for one verified probability, at most.
    """

    method: str = "importance"
    variation: float = 0.02
    calls: int = 1_000_000


class _Counted:
    """A function of design and inputs, and the rows it was called with."""

    def __init__(self, function: Function) -> None:
        self.function = function
        self.rows = 0

    def __call__(self, d: np.ndarray, x: np.ndarray) -> np.ndarray:
        self.rows += len(d)
        return self.function(d, x)


def optimise(
    problem: DesignProblem,
    *,
    seed: int = 0,
    effort: Effort | None = None,
    reference: tuple[float, float] | None = None,
    say: Say = lambda _: None,
) -> Design:
    """Find the best design.

    Parameters
    ----------
    problem
        Variables, inputs, objective and constraints.
    seed
        Of all random numbers: the same seed gives the same design.
    effort
        How probabilities are verified.
    reference
        Mean and standard deviation that eq. (4.18) divides by; by default those of the
        starting design.
    say
        Called with a line of progress after each round.

    Returns
    -------
    The best design, evaluated.

    Raises
    ------
    ValueError
        Where a function of the problem returns NaN or another shape.

    Examples
    --------
    >>> from slowtime.reliability import Problem, unknowns
    >>> from slowtime.design import Constraint, DesignProblem, Variable
    >>> inputs = Problem(unknowns(1), lambda x: x[:, 0])
    >>> margin = Constraint(lambda d, x: d[:, 0] - x[:, 0], 0.01)
    >>> found = optimise(DesignProblem(
    ...     {"strength": Variable(lower=0.0, upper=5.0, start=4.0)}, inputs,
    ...     lambda d, x: d[:, 0], {"strong enough": margin}))
    >>> round(float(found.best.variables[0]), 2)  # the 99 % quantile of a normal variable
    2.33
    """
    effort = effort or Effort()
    counted = {name: _Counted(one.limit_state) for name, one in problem.constraints.items()}
    objective = _Counted(problem.objective)
    problem = dataclasses.replace(
        problem,
        objective=objective,
        constraints={
            name: dataclasses.replace(one, limit_state=counted[name])
            for name, one in problem.constraints.items()
        },
    )
    search = _Search(problem, seed, effort, reference, say)
    best, rounds, warnings = search.run()
    calls = objective.rows + sum(one.rows for one in counted.values())
    start = search.evaluated(problem.begin)
    unit = (best.variables - problem.lower) / problem.width
    bounds = {
        name: "lower" if at < 0.5 else "upper"
        for name, at in zip(problem.names, unit.tolist(), strict=True)
        if min(at, 1.0 - at) <= STILL
    }
    return Design(
        problem.names, problem.alpha, search.objective.reference, start, best, bounds, rounds,
        calls, warnings,
    )  # fmt: skip


def evaluate(
    problem: DesignProblem,
    design: Float[np.ndarray, " variable"],
    reference: tuple[float, float],
    seed: int,
    effort: Effort,
) -> Evaluated:
    r"""Evaluate a design: moments of its objective, and its probabilities of failure.

    Parameters
    ----------
    problem
        Design problem.
    design
        Design variables, in their units.
    reference
        References :math:`\mu^*` and :math:`\sigma^*` of the objective, in its unit.
    seed
        Seed of the points and samples.
    effort
        Method and effort of the reliability estimates.

    Returns
    -------
    Moments, objective, and each constraint with its probability of failure.
    """
    objective = RobustObjective(problem, seed, reference)
    moments = objective.moments(design[None])
    constraints = {
        name: Verified(
            one.probability,
            estimate(
                problem.reliability(name, design),
                effort.method,
                variation=effort.variation,
                calls=effort.calls,
                seed=seed,
            ),
        )
        for name, one in problem.constraints.items()
    }
    value = float(objective(design[None])[0])
    return Evaluated(design, value, float(moments.mean[0]), float(moments.sd[0]), constraints)


class _Search:
    """The alternation of programmes and worst points, for one problem."""

    def __init__(
        self,
        problem: DesignProblem,
        seed: int,
        effort: Effort,
        reference: tuple[float, float] | None,
        say: Say,
    ) -> None:
        self.problem, self.seed, self.effort, self.say = problem, seed, effort, say
        self.objective = RobustObjective(problem, seed, reference)
        self.coarse = RobustObjective(problem, seed, self.objective.reference, COARSE)
        self.wanted = {
            name: -float(ndtri(one.probability)) for name, one in problem.constraints.items()
        }
        self.beta = dict(self.wanted)
        self.worst: dict[str, Float[np.ndarray, "point input"]] = {}
        self.scale: dict[str, float] = {}
        self.rounds = 0

    def run(self) -> tuple[Evaluated, int, tuple[str, ...]]:
        """Best design, the rounds it took, and warnings."""
        unit = (self.problem.begin - self.problem.lower) / self.problem.width
        best: Evaluated | None = None
        settled, violation = True, 0.0
        for correction in range(CORRECTIONS):
            unit, settled, violation = self._settle(unit, wide=correction == 0)
            found = self.evaluated(self._design(unit))
            best = self._better(best, found)
            if violation or not self._corrected(found):
                break
        assert best is not None
        return best, self.rounds, self._warnings(best, settled, violation)

    def _settle(
        self, unit: Float[np.ndarray, " variable"], *, wide: bool
    ) -> tuple[Float[np.ndarray, " variable"], bool, float]:
        violation = 0.0
        for turn in range(ROUNDS):
            self.rounds += 1
            self._find_worst(self._design(unit))
            many = wide and turn == 0
            objective = self.coarse if many else self.objective
            programme = Programme(self._of_unit(objective), self._margins)
            moved, violation = solve(programme, unit, self.seed + self.rounds, wide=many)
            step = float(np.abs(moved - unit).max())
            unit = moved
            value = float(self.objective(self._design(unit)[None])[0])
            self.say(f"round {self.rounds}: objective {value:.5g}, moved by {100 * step:.3g} %")
            if step <= STILL and not many:
                return unit, True, violation
        return unit, False, violation

    def _of_unit(self, objective: RobustObjective) -> Callable[[np.ndarray], np.ndarray]:
        return lambda unit: objective(self._design(unit))

    def _design(self, unit: np.ndarray) -> np.ndarray:
        return np.asarray(self.problem.lower + unit * self.problem.width)

    def _margins(
        self, unit: np.ndarray, names: Sequence[str] | None = None
    ) -> Float[np.ndarray, "design margin"]:
        """Limit states at their worst points, over the spread that they had there."""
        designs = self._design(unit)
        columns = []
        for name in self.worst if names is None else names:
            points = self.worst[name]
            x = self.problem.inputs.physical(points)
            d = np.repeat(designs, len(x), axis=0)
            values = values_of(
                self.problem.constraints[name].limit_state,
                d,
                np.tile(x, (len(designs), 1)),
                f"The limit state {name}",
            )
            columns.append(values.reshape(len(designs), len(x)) / self.scale[name])
        return np.concatenate(columns, axis=1) if columns else np.zeros((len(unit), 0))

    def _find_worst(self, design: np.ndarray) -> None:
        for number, name in enumerate(self.problem.constraints):
            rng = np.random.default_rng([self.seed, self.rounds, number])
            reliability = self.problem.reliability(name, design)
            points, values = worst_points(
                reliability, self.beta[name], rng, self.worst.get(name)
            )
            origin = np.zeros((1, reliability.size))
            middle = float(reliability.limit_state(reliability.physical(origin))[0])
            spread = abs(middle - float(values[0]))
            self.worst[name] = points
            self.scale[name] = spread if spread > 0.0 else max(abs(middle), 1.0)

    def evaluated(self, design: np.ndarray) -> Evaluated:
        """Evaluate a design by the settings of this search."""
        return evaluate(self.problem, design, self.objective.reference, self.seed, self.effort)

    def _corrected(self, found: Evaluated) -> bool:
        """Move each distance by what the first-order approximation missed; False if none."""
        changed = False
        for name, one in found.constraints.items():
            verified, wanted = one.found.beta, self.wanted[name]
            error = wanted - verified
            if not np.isfinite(error) or abs(error) <= CLOSE:
                continue
            unit = self._unit(found.variables)[None]
            active = float(self._margins(unit, (name,)).min()) < ACTIVE
            if error > 0.0 or active:
                self.beta[name] = max(self.beta[name] + error, 0.0)
                changed = True
        return changed

    def _unit(self, design: np.ndarray) -> np.ndarray:
        return np.asarray((design - self.problem.lower) / self.problem.width)

    def _better(self, best: Evaluated | None, found: Evaluated) -> Evaluated:
        if best is None:
            return found
        return min(best, found, key=lambda one: (self._shortfall(one), one.value))

    def _shortfall(self, found: Evaluated) -> float:
        """Largest lack of reliability index beyond what counts as close."""
        lacks = [self.wanted[name] - one.found.beta for name, one in found.constraints.items()]
        worst = max(lacks, default=0.0)
        return worst if worst > CLOSE else 0.0

    def _warnings(self, best: Evaluated, settled: bool, violation: float) -> tuple[str, ...]:
        told = []
        missed = [name for name, one in best.constraints.items() if one.met is False]
        if violation or missed:
            worst = ", ".join(
                f"{name} fails with probability {best.constraints[name].found.probability:.3g}"
                f" (accepted: {best.constraints[name].accepted:.3g})"
                for name in missed or best.constraints
            )
            told.append(
                f"No design within the bounds meets every constraint. The nearest: {worst}. "
                "Widen the bounds, add a variable, or accept a larger probability."
            )
        if not settled:
            told.append(
                f"The design still moved after {ROUNDS} rounds. Compare it with another seed."
            )
        for name, one in best.constraints.items():
            told += [f"{name}: {said}" for said in one.found.warnings]
        return tuple(told)
