"""Surrogates of slow responses, learnt from a few runs.

The logarithm of each response is learnt over the design variables and the normal scores of the
inputs. Runs are spread evenly at first; later ones are made where the optimisation looks: at
the designs found and their worst points, until the surrogate agrees there.
"""

import dataclasses
import warnings as python_warnings
from collections.abc import Callable

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtri

from slowtime.reliability import Problem
from slowtime.surrogate import SurrogateWarning

from .inverse_form import worst_points
from .optimisation import Effort, Say, evaluate, optimise
from .problem import DesignProblem
from .result import Design

Rows = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From design variables [row variable] and inputs [row input] to responses [row response]."""

EDGE = 4.0
"""Half-width of the box of the first runs, in standard normal space."""

FIRST_SHARE = 0.6
"""Share of the runs that are spread evenly; the others are made where it matters."""

ROUND = 24
"""Runs of a refinement: the worst points, and draws of the inputs at the design found."""

AGREES = 0.02
"""Relative error at a refinement's runs below which the surrogate is good enough."""

PIECE = 20_000
"""Rows that a surrogate is asked for at once, which bounds its memory."""


@dataclasses.dataclass
class Emulator:
    """Responses by surrogates.

    Parameters
    ----------
    run
        The slow responses, all positive.
    problem
        Inputs, which give the transformation to normal scores.
    lower, width
        Of the design variables.
    """

    run: Rows
    problem: Problem
    lower: Float[np.ndarray, " variable"]
    width: Float[np.ndarray, " variable"]
    runs: int = 0

    def __post_init__(self) -> None:
        size = len(self.lower) + self.problem.size
        self._points = np.zeros((0, size))
        self._logs: np.ndarray | None = None
        self._models: list[object] = []

    def start(self, count: int, seed: int) -> None:
        """Make the first runs, spread evenly over designs and inputs."""
        size = len(self.lower) + self.problem.size
        sobol = scipy.stats.qmc.Sobol(size, rng=np.random.default_rng(seed))
        unit = sobol.random(1 << (count - 1).bit_length())[:count]
        split = len(self.lower)
        unit[:, split:] = EDGE * (2.0 * unit[:, split:] - 1.0)
        self._take(unit)

    def refine(self, designs: np.ndarray, scores: np.ndarray) -> float:
        """Run at further points, and return the largest relative error of the surrogates there.

        Parameters
        ----------
        designs
            Design variables of each run [row, variable].
        scores
            Normal scores of the inputs of each run [row, input].

        Returns
        -------
        Largest relative error before the points were learnt [1].
        """
        at = np.column_stack([(designs - self.lower) / self.width, scores])
        known = self._predict(at)
        self._take(at)
        assert self._logs is not None
        return float(np.abs(np.expm1(known - self._logs[-len(at) :])).max())

    def __call__(self, d: np.ndarray, x: np.ndarray) -> Float[np.ndarray, "row response"]:
        """Responses by surrogate."""
        scores = np.clip(self.problem.standard(x), -2.0 * EDGE, 2.0 * EDGE)
        at = np.column_stack([(d - self.lower) / self.width, scores])
        pieces = [self._predict(at[k : k + PIECE]) for k in range(0, len(at), PIECE)]
        return np.asarray(np.exp(np.concatenate(pieces)))

    def _predict(self, at: np.ndarray) -> np.ndarray:
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", SurrogateWarning)
            each = [model.predict(at) for model in self._models]  # type: ignore[attr-defined]
        return np.column_stack(each)

    def _take(self, unit: np.ndarray) -> None:
        from slowtime.surrogate import GaussianProcess

        split = len(self.lower)
        d = self.lower + unit[:, :split] * self.width
        responses = self.run(d, self.problem.physical(unit[:, split:]))
        if not (responses > 0.0).all():
            raise ValueError("A response is not positive, so that its logarithm has no value.")
        self.runs += len(unit)
        logs = np.log(responses)
        self._points = np.concatenate([self._points, unit])
        self._logs = logs if self._logs is None else np.concatenate([self._logs, logs])
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", SurrogateWarning)
            self._models = [
                GaussianProcess().fit(self._points, column) for column in self._logs.T
            ]


def optimise_emulated(
    assemble: Callable[[Rows], DesignProblem],
    run: Rows,
    runs: int,
    *,
    seed: int = 0,
    effort: Effort | None = None,
    say: Say = lambda _: None,
) -> Design:
    """Find the best design on surrogates of slow responses, and verify it by the responses.

    Parameters
    ----------
    assemble
        Makes the problem from a function that gives the responses.
    run
        The slow responses, all positive.
    runs
        Rows of `run` that surrogates may be learnt from.
    seed
        Seed of the runs and of the optimisation.
    effort
        Effort of the optimisation and of the reliability estimates.
    say
        Called with each message of progress.

    Returns
    -------
    The design, evaluated with the responses themselves. Its warnings tell where surrogate and
    responses still differ.
    """
    effort = effort or Effort()
    true = assemble(run)
    emulator = Emulator(run, true.inputs, true.lower, true.width)
    emulator.start(max(int(FIRST_SHARE * runs), 10), seed)
    say(f"{emulator.runs} runs of the model spread evenly")
    emulated = assemble(emulator)
    while True:
        found = optimise(emulated, seed=seed, effort=effort, say=say)
        if emulator.runs + ROUND > runs:
            error = np.inf
            break
        design = found.best.variables
        scores = _doubtful(emulated, design, seed + emulator.runs)
        error = emulator.refine(np.tile(design, (len(scores), 1)), scores)
        say(f"{emulator.runs} runs; the surrogate was {100 * error:.2g} % off at the design")
        if error <= AGREES:
            break
    start, best = (
        evaluate(true, one.variables, found.reference, seed, effort)
        for one in (found.start, found.best)
    )
    warnings = [one for one in found.warnings if not one.startswith("No design")]
    if error > AGREES:
        warnings.append(
            f"The surrogates had not settled within {runs} runs. Allow more runs "
            "(surrogate_runs)."
        )
    for name, one in best.constraints.items():
        if one.met is False:
            warnings.append(
                f"By the model itself, {name} fails with probability "
                f"{one.found.probability:.3g} (accepted: {one.accepted:.3g}). Allow more "
                "runs (surrogate_runs)."
            )
    return dataclasses.replace(
        found, start=start, best=best, calls=emulator.runs, warnings=tuple(warnings)
    )


def _doubtful(
    problem: DesignProblem, design: np.ndarray, seed: int
) -> Float[np.ndarray, "run input"]:
    """Give normal scores to run at: worst points of each constraint, and draws."""
    rng = np.random.default_rng(seed)
    found = []
    for name, one in problem.constraints.items():
        beta = max(-float(ndtri(one.probability)), 0.0)
        points, _ = worst_points(problem.reliability(name, design), beta, rng)
        found += list(points[:4])
    drawn = rng.standard_normal((max(ROUND - len(found), 0), problem.inputs.size))
    return np.array([*found, *drawn])[:ROUND]
