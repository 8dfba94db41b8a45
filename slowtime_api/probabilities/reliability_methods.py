"""Probabilities of failure by several methods."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from slowtime.reliability import METHODS, Problem, estimate
from slowtime.reliability import Result as MethodResult
from slowtime_api.arguments import existing_file
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Bounds, Count, checked
from slowtime_services.problem_files.reliability import read_stated_problem
from slowtime_services.problem_files.stated import Stated

Method = Literal[
    "mean-value", "form", "sorm-breitung", "sorm-tvedt", "system", "monte-carlo", "stratified",
    "importance", "directional", "subset", "cross-entropy", "active", "all",
]  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FailureProbability(Result):
    """Probability of failure by each method.

    Parameters
    ----------
    problem
        Inputs, dependence and limit state.
    stated
        What the owner states of the problem: name, failure, period, accepted probability.
    results
        One result per method: probability, 95 % interval, reliability index, coefficient of
        variation, calls of the limit state, design points and warnings.
    refused
        Methods that could not be applied, and why.
    seed
        Of the random samples.
    """

    problem: Problem
    stated: Stated
    results: tuple[MethodResult, ...]
    refused: dict[str, str]
    seed: int

    def __getitem__(self, method: str) -> MethodResult:
        """Return the result of a method.

        Raises
        ------
        KeyError
            If it was not applied.
        """
        for one in self.results:
            if one.method == method:
                return one
        applied = ", ".join(one.method for one in self.results)
        raise KeyError(f"There is no result of {method!r}. Applied were: {applied}.")

    @property
    def heading(self) -> str:
        """What was computed, in a line."""
        return f"Probability of failure, {len(self.problem.names)} inputs"

    def rows(self) -> list[dict[str, Any]]:
        """Return each method.

        Returns
        -------
        One dictionary per method: ``method``, ``probability``, ends ``lo`` and ``hi`` of the
        95 % interval (None where there is none), ``beta``, ``variation`` and ``calls`` [1].
        """
        return [
            {
                "method": one.method, "probability": one.probability,
                "lo": None if one.interval is None else one.interval[0],
                "hi": None if one.interval is None else one.interval[1],
                "beta": one.beta, "variation": one.variation, "calls": one.calls,
            }
            for one in self.results
        ]  # fmt: skip

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the probability of each method with its 95 % interval.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        for k, one in enumerate(self.results):
            low, high = one.interval or (one.probability, one.probability)
            axes.plot([k, k], [low, high], color="C0")
            axes.plot(k, one.probability, "o", color="C0")
        axes.set_xticks(range(len(self.results)), [one.method for one in self.results])
        if all(one.probability > 0.0 for one in self.results):
            axes.set_yscale("log")
        axes.set(ylabel="probability of failure [1]")
        return save(axes, path)


@checked
def failure_probability(
    problem: Problem | str | Path,
    methods: Sequence[Method] = ("form", "importance", "subset"),
    *,
    limit_state: str | Path | None = None,
    variation: Annotated[float, Bounds(above=0, below=1)] = 0.05,
    calls: Count = 5_000_000,
    seed: int = 0,
) -> FailureProbability:
    """Compute a probability of failure by several methods.

    Parameters
    ----------
    problem
        `slowtime.reliability.Problem` of random inputs and a limit state, which fails where it
        is at most 0; or the path of a file (YAML, JSON, or Python that is executed).
    methods
        Names of `slowtime.reliability.METHODS`, or ``["all"]``.
    limit_state
        Python file whose function ``g`` is the limit state of a file without one.
    variation
        Coefficient of variation of the probability at which sampling stops [1].
    calls
        Maximum number of evaluations of the limit state, for each method.
    seed
        Of the random samples.

    Returns
    -------
    A result for each method.

    Raises
    ------
    ValueError
        If no method could be applied, or the file cannot be used.

    References
    ----------
    .. [1] O. Ditlevsen and H. O. Madsen, Structural Reliability Methods, Wiley, 1996.

    Examples
    --------
    >>> from slowtime.reliability import Problem, marginal
    >>> normal = marginal("normal", mean=0.0, sd=1.0)
    >>> found = failure_probability(Problem({"u": normal}, lambda x: 3.0 - x[:, 0]), ["form"])
    >>> round(found["form"].beta, 6)
    3.0
    """
    if isinstance(problem, Problem):
        if limit_state is not None:
            raise ValueError(
                f"limit_state={limit_state!s} was given with a Problem, which has its own. "
                "Leave it out."
            )
        read, stated = problem, Stated()
    else:
        own = None if limit_state is None else existing_file(limit_state)
        read, stated = read_stated_problem(existing_file(problem), own)
    wanted = METHODS if "all" in methods else dict.fromkeys(methods)
    found: list[MethodResult] = []
    refused: dict[str, str] = {}
    for method in wanted:
        try:
            found.append(estimate(read, method, variation=variation, calls=calls, seed=seed))
        except ValueError as error:
            refused[method] = str(error)
    if not found:
        raise ValueError("; ".join(f"{method}: {said}" for method, said in refused.items()))
    return FailureProbability(
        problem=read, stated=stated, results=tuple(found), refused=refused, seed=seed
    )
