"""Surrogates beside chaospy, OpenTURNS and scikit-learn on the same points.

Run `make surrogates`, or `python -m benchmarks.methods.surrogates [--seeds 3] [--write PAGE]`
where the peers are installed. Designs are Latin hypercubes of 50 and 200 points; the error is
the root mean square over independent points, over the spread of the output, median over
designs. Peers are given what their users would give them: degrees of polynomials chosen by
their own error estimate or by cross-validation, two kernels each, inputs and outputs scaled.
Warnings of ours are counted, not hidden: of each method that erred by more than half the spread
it is asked whether its band or a warning told.
"""

import argparse
import dataclasses
import importlib.util
import pathlib
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from slowtime import surrogate
from slowtime.surrogate.problems import PROBLEMS, BoxProblem, ishigami_sobol

SIZES = (50, 200)
TESTS = 2000
Predict = Callable[[np.ndarray], np.ndarray]
Method = Callable[[BoxProblem, np.ndarray, np.ndarray], Predict]


def ours() -> dict[str, Callable[[BoxProblem], surrogate.Surrogate]]:
    """Our surrogates by name, told no more than the peers: the laws of the inputs."""
    return {
        "polynomial chaos": lambda p: surrogate.PolynomialChaos(marginals=p.marginals),
        "generalised ANOVA": lambda p: surrogate.GeneralisedAnova(marginals=p.marginals),
        "H-PCFE": lambda p: surrogate.HybridExpansion(marginals=p.marginals),
        "H-PCFE, Matérn 5/2": lambda p: surrogate.HybridExpansion(
            marginals=p.marginals, kernel="matern52"
        ),
        "process, Matérn 5/2": lambda _: surrogate.GaussianProcess(),
        "process, squared exponential": lambda _: surrogate.GaussianProcess(
            "squared exponential"
        ),
        "process, linear trend": lambda _: surrogate.GaussianProcess(
            "squared exponential", trend="linear"
        ),
        "support vectors": lambda _: surrogate.SupportVectors(),
        "networks": lambda _: surrogate.NetworkEnsemble(),
    }


def unit(problem: BoxProblem, x: np.ndarray) -> np.ndarray:
    """Scale inputs to the unit cube, as the peers are given them."""
    return np.asarray((x - problem.lo) / (problem.hi - problem.lo))


def sklearn_process(smoothness: float) -> Method:
    """scikit-learn's process, a length per input, three searches."""

    def fit(problem: BoxProblem, x: np.ndarray, y: np.ndarray) -> Predict:
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        kernel = ConstantKernel(1.0, (1e-4, 1e4)) * Matern(
            np.ones(x.shape[1]), (0.02, 500.0), nu=smoothness
        ) + WhiteKernel(1e-6, (1e-11, 1.0))
        process = GaussianProcessRegressor(
            kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0
        ).fit(unit(problem, x), y)
        return lambda new: np.asarray(process.predict(unit(problem, new)))

    return fit


def sklearn_support(problem: BoxProblem, x: np.ndarray, y: np.ndarray) -> Predict:
    """scikit-learn's support vectors after a grid search."""
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.model_selection import GridSearchCV
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVR

    grid = {
        "regressor__C": [1.0, 10.0, 100.0],
        "regressor__gamma": list(np.array([0.03, 0.1, 0.3, 1.0]) / x.shape[1]),
    }
    machine = TransformedTargetRegressor(SVR(epsilon=0.01), transformer=StandardScaler())
    scale = StandardScaler().fit(x)
    search = GridSearchCV(machine, grid, cv=5).fit(scale.transform(x), y)
    return lambda new: np.asarray(search.predict(scale.transform(new)))


def chaospy_expansion(problem: BoxProblem, x: np.ndarray, y: np.ndarray) -> Predict:
    """Chaospy's expansion: least squares, or LARS where it has more terms; degree by folds."""
    import chaospy
    from sklearn.linear_model import LarsCV
    from sklearn.model_selection import KFold

    law = chaospy.J(
        *[chaospy.Uniform(a, b) for a, b in zip(problem.lo, problem.hi, strict=True)]
    )
    folds = list(KFold(5, shuffle=True, random_state=0).split(x))
    best: tuple[float, Any] = (np.inf, None)
    for degree in range(1, 11):
        expansion = chaospy.generate_expansion(degree, law, normed=True)
        if len(expansion) > 3 * len(y):
            break
        columns = np.asarray(expansion(*x.T)).T

        def solve(rows: np.ndarray, columns: np.ndarray = columns) -> np.ndarray:
            if 1.5 * columns.shape[1] < len(rows):
                return np.asarray(np.linalg.lstsq(columns[rows], y[rows])[0])
            found = LarsCV(cv=5).fit(columns[rows, 1:], y[rows])
            return np.concatenate([[found.intercept_], found.coef_])

        errors = [y[rest] - columns[rest] @ solve(seen) for seen, rest in folds]
        score = float(np.mean(np.concatenate(errors) ** 2))
        if score < best[0]:
            best = score, (expansion, solve(np.arange(len(y))))
    expansion, coefficients = best[1]
    return lambda new: np.asarray(np.asarray(expansion(*new.T)).T @ coefficients)


def openturns_expansion(problem: BoxProblem, x: np.ndarray, y: np.ndarray) -> Predict:
    """OpenTURNS' sparse expansion: LARS with corrected leave-one-out, degree by folds."""
    import openturns as ot
    from sklearn.model_selection import KFold

    laws = [ot.Uniform(float(a), float(b)) for a, b in zip(problem.lo, problem.hi, strict=True)]
    counting = ot.LinearEnumerateFunction(len(laws))
    factory = [ot.StandardDistributionPolynomialFactory(law) for law in laws]
    basis = ot.OrthogonalProductPolynomialFactory(factory, counting)

    def solve(rows: np.ndarray, size: int) -> Any:
        chosen = ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
        algorithm = ot.FunctionalChaosAlgorithm(
            ot.Sample(x[rows]),
            ot.Sample(y[rows, None]),
            ot.JointDistribution(laws),
            ot.FixedStrategy(basis, size),
            ot.LeastSquaresStrategy(chosen),
        )
        algorithm.run()
        return algorithm.getResult().getMetaModel()

    folds = list(KFold(5, shuffle=True, random_state=0).split(x))
    best: tuple[float, int] = (np.inf, 0)
    for degree in range(1, 11):
        size = counting.getBasisSizeFromTotalDegree(degree)
        if size > 5 * len(y):
            break
        errors = [
            y[rest] - np.asarray(solve(seen, size)(ot.Sample(x[rest])))[:, 0]
            for seen, rest in folds
        ]
        score = float(np.mean(np.concatenate(errors) ** 2))
        if score < best[0]:
            best = score, size
    model = solve(np.arange(len(y)), best[1])
    return lambda new: np.asarray(model(ot.Sample(new)))[:, 0]


def openturns_process(smoothness: float) -> Method:
    """OpenTURNS' kriging, a length per input, the likeliest of three searches."""

    def fit(problem: BoxProblem, x: np.ndarray, y: np.ndarray) -> Predict:
        import openturns as ot

        inputs = x.shape[1]
        mean, spread = float(y.mean()), float(y.std())
        fitted = []
        # From its own start at short lengths it often does not move at all.
        for length in (0.5, 1.5, 4.0):
            kernel = (
                ot.SquaredExponential([length] * inputs, [1.0])
                if np.isinf(smoothness)
                else ot.MaternModel([length] * inputs, [1.0], smoothness)
            )
            fitter = ot.GaussianProcessFitter(
                ot.Sample(unit(problem, x)),
                ot.Sample((y[:, None] - mean) / spread),
                kernel,
                ot.ConstantBasisFactory(inputs).build(),
            )
            fitter.setOptimizationBounds(ot.Interval([0.02] * inputs, [100.0] * inputs))
            fitter.run()
            fitted.append(fitter.getResult())
        likeliest = max(fitted, key=lambda one: one.getOptimalLogLikelihood())
        process = ot.GaussianProcessRegression(likeliest)
        process.run()
        model = process.getResult().getMetaModel()
        return lambda new: (
            mean + spread * np.asarray(model(ot.Sample(unit(problem, new))))[:, 0]
        )

    return fit


PEERS: dict[str, tuple[str, Method]] = {
    "chaospy, expansion": ("chaospy", chaospy_expansion),
    "OpenTURNS, sparse expansion": ("openturns", openturns_expansion),
    "OpenTURNS, process, Matérn 5/2": ("openturns", openturns_process(2.5)),
    "OpenTURNS, process, squared exponential": ("openturns", openturns_process(np.inf)),
    "scikit-learn, process, Matérn 5/2": ("sklearn", sklearn_process(2.5)),
    "scikit-learn, process, squared exponential": ("sklearn", sklearn_process(np.inf)),
    "scikit-learn, support vectors": ("sklearn", sklearn_support),
}


@dataclasses.dataclass(slots=True)
class Scores:
    """What one method did on one problem and size, design by design."""

    errors: list[float] = dataclasses.field(default_factory=list)
    coverage: list[float] = dataclasses.field(default_factory=list)
    seconds: list[float] = dataclasses.field(default_factory=list)
    silent: int = 0
    """Designs on which it erred by more than half the spread and neither warned nor knew."""


Table = dict[tuple[str, int], dict[str, Scores]]


def measure(table: Table, seed: int) -> None:
    """Run every method on one design of every problem and size."""
    for (name, size), cell in table.items():
        problem = PROBLEMS[name]
        new, truth = problem.draws(TESTS, np.random.default_rng(12345))
        x, y = problem.design(size, np.random.default_rng([seed, size]))
        for own, make in ours().items():
            # That corners of the cube lie off a design is no news here.
            one = make(problem).set_params(extrapolation="ignore")
            _ours(cell.setdefault(own, Scores()), one, x, y, new, truth)
        for peer, (needs, method) in PEERS.items():
            if importlib.util.find_spec(needs) is not None:
                _theirs(cell.setdefault(peer, Scores()), method, problem, x, y, new, truth)
        print(f"design {seed + 1}: {name}, {size} points", flush=True)


def _ours(
    tally: Scores,
    one: surrogate.Surrogate,
    x: np.ndarray,
    y: np.ndarray,
    new: np.ndarray,
    truth: np.ndarray,
) -> None:
    begun = time.process_time()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        one.fit(x, y)
        mean, sd = one.predict(new, return_std=True)
        lo, hi = one.predict_interval(new)
    tally.seconds.append(time.process_time() - begun)
    error = float(np.sqrt(np.mean((mean - truth) ** 2)) / truth.std())
    tally.errors.append(error)
    tally.coverage.append(float(np.mean((lo <= truth) & (truth <= hi))))
    knew = bool(said) or float(np.sqrt(np.mean(sd**2)) / truth.std()) > 0.25
    tally.silent += error > 0.5 and not knew


def _theirs(
    tally: Scores,
    method: Method,
    problem: BoxProblem,
    x: np.ndarray,
    y: np.ndarray,
    new: np.ndarray,
    truth: np.ndarray,
) -> None:
    begun = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mean = method(problem, x, y)(new)
    tally.seconds.append(time.process_time() - begun)
    tally.errors.append(float(np.sqrt(np.mean((mean - truth) ** 2)) / truth.std()))


def page(table: Table, seeds: int) -> tuple[str, bool]:
    """Markdown of the whole comparison, and whether ours is at or below the best peer."""
    columns = list(table)
    lines = [
        "# Surrogates beside other libraries",
        "",
        "Written by `make surrogates`. Root mean square error at "
        f"{TESTS:,} independent points over the spread of the output, in per cent; median "
        f"over designs (Latin hypercubes, number of them: {seeds}), the same for all. Bold: "
        "the best of ours and of theirs.",
        "",
        "| method | " + " | ".join(f"{name} {size}" for name, size in columns) + " |",
        "|---|" + "---:|" * len(columns),
    ]
    mine = [name for name in next(iter(table.values())) if name in ours()]
    others = [name for name in next(iter(table.values())) if name not in ours()]
    median = {
        (key, name): float(np.median(tally.errors))
        for key, cell in table.items()
        for name, tally in cell.items()
    }
    best = {
        key: [min((median[key, n] for n in group), default=np.inf) for group in (mine, others)]
        for key in columns
    }
    for k, group in enumerate((mine, others)):
        for name in group:
            cells = []
            for key in columns:
                text = f"{100 * median[key, name]:.2g}"
                cells.append(f"**{text}**" if median[key, name] <= best[key][k] else text)
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    ratios = [f"{best[key][0] / best[key][1]:.2f}" for key in columns]
    lines += ["| best of ours over best of the others | " + " | ".join(ratios) + " |", ""]
    lines += _bands(table, mine, columns) + _indices()
    return "\n".join(lines) + "\n", all(one <= other for one, other in best.values())


def _bands(table: Table, mine: list[str], columns: list[tuple[str, int]]) -> list[str]:
    lines = [
        "How often the 95 % band of ours held the function, in per cent, mean over designs; "
        "and CPU seconds to learn and foretell, the longest.",
        "",
        "| method | " + " | ".join(f"{name} {size}" for name, size in columns) + " | CPU s |",
        "|---|" + "---:|" * (len(columns) + 1),
    ]
    for name in mine:
        cells = [f"{100 * np.mean(table[key][name].coverage):.0f}" for key in columns]
        longest = max(max(table[key][name].seconds) for key in columns)
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {longest:.1f} |")
    silent = sum(table[key][name].silent for key in columns for name in mine)
    runs = sum(len(table[key][name].errors) for key in columns for name in mine)
    return [
        *lines,
        "",
        f"Silent failures: {silent} of {runs}. One is counted where the error is above half "
        "the spread, nothing was warned of, and the standard deviation foretold is below a "
        "quarter.",
        "",
    ]


def _indices() -> list[str]:
    problem = PROBLEMS["Ishigami"]
    x, y = problem.design(200, np.random.default_rng([0, 200]))
    found = surrogate.PolynomialChaos(marginals=problem.marginals).fit(x, y)
    first, total = ishigami_sobol()
    lines = [
        "Sobol indices of Ishigami from 200 points, by polynomial chaos:",
        "",
        "| input | first order | exact | total | exact |",
        "|---|---:|---:|---:|---:|",
    ]
    for d in range(3):
        lines.append(
            f"| {d + 1} | {found.sobol_first_[d]:.4f} | {first[d]:.4f} | "
            f"{found.sobol_total_[d]:.4f} | {total[d]:.4f} |"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Print or write the page; status 1 where no surrogate of ours is the best."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=3, help="designs of each size")
    parser.add_argument("--write", type=pathlib.Path, help="where to write the page")
    given = parser.parse_args(arguments)
    missing = {needs for needs, _ in PEERS.values() if importlib.util.find_spec(needs) is None}
    if missing:
        print(f"Not installed here, so not compared with: {', '.join(sorted(missing))}.")
    table: Table = {(name, size): {} for name in PROBLEMS for size in SIZES}
    text, passed = "", False
    for seed in range(given.seeds):
        measure(table, seed)
        text, passed = page(table, seed + 1)
        if given.write is not None:
            given.write.write_text(text)
    print(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
