"""Calls of the limit state beside OpenTURNS and pystra, at equal coefficient of variation.

`.venv-peers/bin/python -m benchmarks.methods.reliability [--seeds 5] [--methods
importance,subset]`. Every method is asked for a coefficient of variation of 5 %, or repeated
until its mean has it: calls are scaled by the square of what was reached over 5 %. The ratio is
ours over the best of the peers of the same kind that was right; a peer whose answers lie on
average more than 20 % off is marked.
"""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from slowtime.reliability import estimate
from tests.slowtime.reliability.problems import Known, every

TARGET = 0.05
PROBLEMS = (
    "plane 2 1e-03", "plane 10 1e-05", "plane 100 1e-03", "strength and load 1e-04",
    "two-sided 1e-04", "four-branch 7", "four-branch 6", "series of 20 planes", "RP8", "RP14",
    "RP22", "RP28", "RP31", "RP33", "RP35", "RP54", "RP75", "RP107",
)  # fmt: skip
MOST_CALLS = 300_000


@dataclasses.dataclass(frozen=True)
class MethodRun:
    """One answer: probability, its coefficient of variation, calls."""

    probability: float
    variation: float
    calls: int
    fixed: bool = False
    """Whether the size of the sample was given, not the target."""

    @property
    def scaled(self) -> float:
        """Calls that the target would have taken; what stopped by itself gets no rebate."""
        factor = (self.variation / TARGET) ** 2
        return self.calls * (max(factor, 1e-3) if self.fixed else max(factor, 1.0))


Peer = Callable[[Known, int], MethodRun]


class _CountedLimitState:
    """The limit state in standard normal space, for peers that want lists."""

    def __init__(self, known: Known) -> None:
        self.known, self.calls = known, 0

    def __call__(self, u: Any) -> np.ndarray:
        points = np.atleast_2d(np.asarray(u, dtype=float))
        self.calls += len(points)
        problem = self.known.problem
        return np.asarray(problem.limit_state(problem.physical(points)))


def _event(known: Known) -> tuple[Any, _CountedLimitState]:
    import openturns as ot

    counted = _CountedLimitState(known)

    class Function(ot.OpenTURNSPythonFunction):  # type: ignore[misc]  # the peer has no types
        def __init__(self) -> None:
            super().__init__(known.problem.size, 1)

        def _exec(self, u: Any) -> list[float]:
            return [float(counted(u)[0])]

        def _exec_sample(self, u: Any) -> Any:
            return counted(u)[:, None].tolist()

    vector = ot.RandomVector(ot.Normal(known.problem.size))
    output = ot.CompositeRandomVector(ot.Function(Function()), vector)
    return ot.ThresholdEvent(output, ot.LessOrEqual(), 0.0), counted


def openturns_importance(known: Known, seed: int) -> MethodRun:
    """FORM from the origin, then importance sampling about its design point."""
    import openturns as ot

    ot.RandomGenerator.SetSeed(seed + 1)
    event, counted = _event(known)
    solver = ot.AbdoRackwitz()
    solver.setMaximumCallsNumber(20_000)
    # From beside the origin: OpenTURNS gives up where the slope there is 0.
    form = ot.FORM(solver, event, [0.1] * known.problem.size)
    form.run()
    centre = form.getResult().getStandardSpaceDesignPoint()
    shifted = ot.Normal(centre, ot.CovarianceMatrix(known.problem.size))
    sampling = ot.ProbabilitySimulationAlgorithm(
        event, ot.ImportanceSamplingExperiment(shifted)
    )
    return _simulated(sampling, counted, 100)


def openturns_directional(known: Known, seed: int) -> MethodRun:
    """Directional sampling, random directions, medium-safe root finding."""
    import openturns as ot

    ot.RandomGenerator.SetSeed(seed + 1)
    event, counted = _event(known)
    sampling = ot.DirectionalSampling(event, ot.MediumSafe(), ot.RandomDirection())
    return _simulated(sampling, counted, 10)


def _simulated(sampling: Any, counted: _CountedLimitState, block: int) -> MethodRun:
    sampling.setBlockSize(block)
    sampling.setMaximumOuterSampling(MOST_CALLS // block)
    sampling.setMaximumCoefficientOfVariation(TARGET)
    sampling.run()
    found = sampling.getResult()
    return MethodRun(
        found.getProbabilityEstimate(), found.getCoefficientOfVariation(), counted.calls
    )


def openturns_subset(known: Known, seed: int) -> MethodRun:
    """Subset sampling with 2,000 points a level; one run, at the variation it states."""
    import openturns as ot

    ot.RandomGenerator.SetSeed(seed + 1)
    event, counted = _event(known)
    sampling = ot.SubsetSampling(event)
    sampling.setBlockSize(100)
    sampling.setMaximumOuterSampling(20)
    sampling.run()
    found = sampling.getResult()
    return MethodRun(
        found.getProbabilityEstimate(), found.getCoefficientOfVariation(), counted.calls, True
    )


def _pystra(known: Known, counted: _CountedLimitState) -> tuple[Any, Any, Any]:
    import pystra

    options = pystra.AnalysisOptions()
    options.setPrintOutput(False)
    model = pystra.StochasticModel()
    names = [f"u{k}" for k in range(known.problem.size)]
    for name in names:
        model.addVariable(pystra.Normal(name, 0.0, 1.0))

    def g(**values: Any) -> Any:
        columns = [np.atleast_1d(values[name]) for name in names]
        return counted(np.stack(np.broadcast_arrays(*columns), axis=1))

    return options, model, pystra.LimitState(_with_names(g, names))


def _with_names(g: Callable[..., Any], names: list[str]) -> Callable[..., Any]:
    """Give a function the argument names that pystra looks for."""
    import inspect

    kinds = inspect.Parameter.POSITIONAL_OR_KEYWORD

    def named(*given: Any, **values: Any) -> Any:
        return g(**dict(zip(names, given, strict=False)), **values)

    parameters = [inspect.Parameter(name, kinds) for name in names]
    named.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return named


def pystra_importance(known: Known, seed: int) -> MethodRun:
    """FORM, then importance sampling about its design point; 2,000 points."""
    import pystra

    np.random.seed(seed)  # noqa: NPY002  # the peer draws from the global generator
    counted = _CountedLimitState(known)
    options, model, limit_state = _pystra(known, counted)
    options.setSamples(2000)
    sampling = pystra.ImportanceSampling(
        analysis_options=options, stochastic_model=model, limit_state=limit_state
    )
    sampling.run()
    return MethodRun(
        float(sampling.Pf), float(np.ravel(sampling.cov_q_bar)[-1]), counted.calls, True
    )


def pystra_subset(known: Known, seed: int) -> MethodRun:
    """Subset simulation with its defaults; one run, at the variation it states."""
    import pystra

    np.random.seed(seed)  # noqa: NPY002  # the peer draws from the global generator
    counted = _CountedLimitState(known)
    options, model, limit_state = _pystra(known, counted)
    sampling = pystra.SubsetSimulation(
        analysis_options=options, stochastic_model=model, limit_state=limit_state
    )
    sampling.run()
    return MethodRun(float(sampling.Pf), float(sampling.cov), counted.calls, True)


PEERS: dict[str, dict[str, Peer]] = {
    "importance": {
        "OpenTURNS FORM-IS": openturns_importance,
        "pystra IS": pystra_importance,
    },
    "directional": {"OpenTURNS directional": openturns_directional},
    "subset": {"OpenTURNS subset": openturns_subset, "pystra subset": pystra_subset},
}


def ours(method: str) -> Peer:
    """One of our methods, asked for the target."""

    def run(known: Known, seed: int) -> MethodRun:
        found = estimate(known.problem, method, variation=TARGET, seed=seed, calls=MOST_CALLS)
        return MethodRun(found.probability, found.variation or np.inf, found.calls)

    return run


def measured(peer: Peer, known: Known, seeds: int) -> tuple[float, float] | None:
    """Mean calls at the target, and mean probability over the truth; None where it failed.

    Where the answers of a method scatter by more than it states, the scatter counts.
    """
    try:
        runs = [peer(known, seed) for seed in range(seeds)]
    except Exception as error:
        print(f"    failed: {type(error).__name__}: {str(error)[:120]}")
        return None
    ratio = np.array([run.probability for run in runs]) / known.exact
    calls = float(np.mean([run.scaled for run in runs]))
    stated = float(np.mean([run.variation for run in runs]))
    if seeds >= 5 and ratio.std(ddof=1) > 1.5 * stated:
        calls *= (ratio.std(ddof=1) / stated) ** 2
    return calls, float(ratio.mean())


def main() -> int:
    """Print a line a problem and method, and the median ratio of each method."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--methods", default="importance,directional,subset")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    given = parser.parse_args()
    known = every()
    for method in given.methods.split(","):
        ratios = []
        for name in given.problems.split(","):
            own = measured(ours(method), known[name], given.seeds)
            line = f"{method:12} {name:24} ours {own[0] if own else np.nan:9.0f}"
            right = []
            for title, peer in PEERS[method].items():
                found = measured(peer, known[name], given.seeds)
                if found is None or not np.isfinite(found[0]):
                    line += f"  {title} failed"
                    continue
                wrong = abs(found[1] - 1.0) > 0.2
                line += f"  {title} {found[0]:9.0f}{f' ({found[1]:.2f} x truth)' * wrong}"
                if not wrong:
                    right.append(found[0])
            if own and right:
                ratios.append(own[0] / min(right))
                line += f"  ratio {ratios[-1]:.2f}"
            print(line, flush=True)
        if ratios:
            print(f"{method}: median ratio {np.median(ratios):.2f} of {len(ratios)} problems")
    return 0


if __name__ == "__main__":
    sys.exit(main())
