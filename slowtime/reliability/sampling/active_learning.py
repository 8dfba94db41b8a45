r"""Active learning of a surrogate of a slow limit state.

A Gaussian process of `slowtime.surrogate` learns g in standard normal space. Importance
sampling on the process tells where failure lies; the next run is made where the sign of g is
least certain and the probability large (Echard, Gayton and Lemaire 2011, on the points of an
importance sample). It ends when points of doubtful sign hold a small share of the probability.
"""

import dataclasses
import warnings as python_warnings
from collections.abc import Callable

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.reliability.design_points.search import Search, find_design_points
from slowtime.reliability.problem import Evaluator, Problem, unknowns
from slowtime.reliability.result import Result, Stopping
from slowtime.surrogate.surrogate_warnings import SurrogateWarning

from .importance import explore

EDGE = 4.5
"""Half-width of the box of the first runs, in standard normal space."""

DOUBT = 0.05
"""Share of the probability that may hang on doubtful signs at the end."""

SURE = 1.96
"""Standard deviations of the process beyond which a sign is not doubted."""

AGAIN = 6
"""Runs after which the importance sample on the process is drawn anew."""

LEAST_SD = 1e-9
POPULATION_VARIATION = 0.02
MOST_POPULATION = 20_000
"""Target and bound of the importance sample on the process, which costs no runs."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Population:
    """Points that stand for the normal distribution near failure."""

    u: Float[np.ndarray, "sample input"]
    weight: Float[np.ndarray, " sample"]
    """Standard normal density over the density they were drawn from."""


def active_learning(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    runs: int = 200,
    first: int | None = None,
    kernel: str = "squared exponential",
) -> Result:
    """Active learning with a Gaussian process, for limit states of minutes or hours a run.

    The interval holds the sampling error and the points whose sign the process doubts; it does
    not hold what the process does not know that it does not know, such as a failure mode in a
    corner without runs.

    Parameters
    ----------
    problem
        Inputs and limit state.
    rng
        Generator of the samples.
    stopping
        Targets of the sampling.
    runs
        Runs of the limit state at most, the first ones included.
    first
        Runs of the first design, spread evenly; 10 and 2 per input if None.
    kernel
        Of `slowtime.surrogate.GaussianProcess`.

    Returns
    -------
    Probability of failure, with its interval.

    References
    ----------
    .. [1] B. Echard, N. Gayton and M. Lemaire, "AK-MCS: An active learning reliability method
       combining Kriging and Monte Carlo simulation", Struct. Saf. 33 (2011) 145-154.
    """
    g = Evaluator(problem)
    most = min(runs, stopping.calls)
    count = min(10 + 2 * problem.size if first is None else first, most)
    design = EDGE * (
        2.0 * scipy.stats.qmc.LatinHypercube(problem.size, rng=rng).random(count) - 1.0
    )
    design = np.concatenate([np.zeros((1, problem.size)), design])[:most]
    values = g(design)
    population: _Population | None = None
    while True:
        predict = _learn(design, _tamed(values), kernel)
        if population is None or (len(design) - count) % AGAIN == 0:
            population = _near_failure(problem.size, predict, rng)
        middle, lo, hi, best = _judge(population, predict)
        settled = middle > 0.0 and (hi - lo) <= 2.0 * DOUBT * middle
        if settled:
            fresh = _near_failure(problem.size, predict, rng)
            middle, lo, hi, best_again = _judge(fresh, predict)
            settled = (hi - lo) <= 2.0 * DOUBT * middle and len(design) > count + 3
            population, best = fresh, best if settled else best_again
        if settled or len(design) >= most:
            break
        design = np.concatenate([design, best[None]])
        values = np.concatenate([values, g(best[None])])
    told = (
        f"{np.sum(~np.isfinite(values))} of {len(values)} runs have no value and count as "
        "failed: how near to failure they are is unknown, and the interval may be too narrow. "
        "Compare with directional simulation.",
    )
    doubts = () if np.isfinite(values).all() else told
    return _result(population, predict, (middle, lo, hi), g.calls, settled, doubts)


Predict = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _tamed(values: np.ndarray) -> np.ndarray:
    """Keep what counts as failed finite, and the largest values from ruling the scale."""
    finite = values[np.isfinite(values)]
    middle = (float(np.median(np.abs(finite))) if len(finite) else 0.0) or 1.0
    # Minus infinity says that a point fails, and not how much; a cliff would rule the process.
    values = np.where(np.isfinite(values), values, -middle)
    size = 10.0 * middle
    if np.all(np.abs(values) <= size):
        return values
    return np.asarray(size * np.arcsinh(np.clip(values / size, -1e3, 1e3)))


def _learn(design: np.ndarray, values: np.ndarray, kernel: str) -> Predict:
    from slowtime.surrogate import GaussianProcess

    with python_warnings.catch_warnings():
        # Points of a search crowd together, and predictions reach beyond them by intent.
        python_warnings.simplefilter("ignore", SurrogateWarning)
        process = GaussianProcess(
            kernel,
            trend="linear" if len(design) > 2 * design.shape[1] + 2 else "constant",
            starts=1,
            folds=1,
            nugget=1e-6 * float(values.std()),
            extrapolation="ignore",
        ).fit(design, values)

    def predict(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean, sd = process.predict(u, return_std=True)
        return mean, np.maximum(sd, LEAST_SD)

    return predict


def _near_failure(inputs: int, predict: Predict, rng: np.random.Generator) -> _Population:
    """Draw an importance sample of the process, with the density ratio of each point."""

    def mean(u: np.ndarray) -> np.ndarray:
        return predict(u)[0]

    g = Evaluator(Problem(unknowns(inputs), mean))
    search = Search(rounds=3, most_points=12)
    found = find_design_points(g, rng, search)
    stopping = Stopping(POPULATION_VARIATION, g.calls + MOST_POPULATION)
    sample, _ = explore(g, rng, stopping, found, search)
    return _Population(sample.u, sample.ratios())


def _judge(population: _Population, predict: Predict) -> tuple[float, float, float, np.ndarray]:
    """Probability, its ends by doubtful signs, and the point to run next."""
    mean, sd = predict(population.u)
    weight = population.weight / len(population.u)
    ends = [float(weight[mean + shift * sd <= 0.0].sum()) for shift in (0.0, SURE, -SURE)]
    doubt = population.weight * ndtr(-np.abs(mean) / sd)
    return ends[0], ends[1], ends[2], population.u[int(np.argmax(doubt))]


def _result(
    population: _Population,
    predict: Predict,
    ends: tuple[float, float, float],
    calls: int,
    settled: bool,
    doubts: tuple[str, ...],
) -> Result:
    warnings = [*doubts]
    if not settled:
        warnings.append(
            f"After {calls} runs the sign of the limit state is still doubtful where it "
            "counts. Allow more runs, or use another method."
        )
    middle, lo, hi = ends
    if middle <= 0.0:
        warnings.append("The process finds no failure.")
        return Result("active", 0.0, None, "nothing failed", np.inf, calls, (), tuple(warnings))
    weight = np.where(predict(population.u)[0] <= 0.0, population.weight, 0.0)
    sampling = float(weight.std(ddof=1) / np.sqrt(len(weight)) / weight.mean())
    half = float(np.exp(SURE * np.sqrt(np.log1p(sampling**2))))
    variation = float(np.hypot(sampling, 0.25 * (hi - lo) / middle))
    return Result(
        "active",
        min(middle, 1.0),
        (lo / half, min(hi * half, 1.0)),
        "",
        variation,
        calls,
        warnings=tuple(warnings),
    )
