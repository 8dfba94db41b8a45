"""All reliability methods by name, and one function to apply them."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from .design_points.first_order import form, mean_value
from .design_points.second_order import sorm
from .design_points.system import system
from .problem import Problem
from .result import Result, Stopping
from .sampling.active_learning import active_learning
from .sampling.cross_entropy import cross_entropy
from .sampling.directional import directional
from .sampling.importance import importance
from .sampling.monte_carlo import monte_carlo
from .sampling.stratified import stratified
from .sampling.subset import subset_simulation


@runtime_checkable
class MethodCall(Protocol):
    """What each method is called with; further settings have defaults."""

    def __call__(
        self, problem: Problem, rng: np.random.Generator, stopping: Stopping, /
    ) -> Result:
        """Estimate the probability of failure."""


@dataclasses.dataclass(frozen=True, slots=True)
class Method:
    """A member of the family."""

    name: str
    title: str
    run: MethodCall
    interval: bool
    """Whether it gives a 95 % interval; an approximation gives none."""


_MEMBERS = (
    Method("mean-value", "mean-value index (Cornell)", mean_value, False),
    Method("form", "first-order reliability method", form, False),
    Method("sorm-breitung", "second-order method, Breitung's formula", sorm, False),
    Method(
        "sorm-tvedt",
        "second-order method, Tvedt's formula",
        functools.partial(sorm, formula="tvedt"),
        False,
    ),
    Method("system", "series or parallel system by multivariate normal", system, False),
    Method(
        "monte-carlo", "crude Monte Carlo, for probabilities from 1e-4 on", monte_carlo, True
    ),
    Method("stratified", "stratified sampling by radius", stratified, True),
    Method("importance", "importance sampling about all design points", importance, True),
    Method("directional", "directional simulation", directional, True),
    Method("subset", "subset simulation", subset_simulation, True),
    Method("cross-entropy", "cross-entropy method", cross_entropy, True),
    Method("active", "active learning with a Gaussian process", active_learning, True),
)
METHODS: Mapping[str, Method] = {method.name: method for method in _MEMBERS}
"""Name → method, approximations first."""


def estimate(
    problem: Problem,
    method: str = "importance",
    *,
    variation: float = 0.05,
    calls: int = 5_000_000,
    seed: int = 0,
) -> Result:
    """Probability of failure of a problem by one method.

    Parameters
    ----------
    problem
        Inputs and limit state.
    method
        A name of `METHODS`.
    variation
        Coefficient of variation at which sampling stops.
    calls
        Calls of the limit state at most.
    seed
        Of all random numbers: the same seed gives the same result.

    Returns
    -------
    Probability of failure, with its interval.

    Raises
    ------
    ValueError
        For an unknown method, or a limit state that a method cannot use.

    Examples
    --------
    >>> from .problem import unknowns
    >>> plane = Problem(unknowns(2), lambda u: 3.0 - u[:, 0])
    >>> round(estimate(plane, "form").beta, 6)
    3.0
    """
    if method not in METHODS:
        raise ValueError(f"Method {method!r} is not known. Allowed: {', '.join(METHODS)}.")
    stopping = Stopping(variation, calls)
    return METHODS[method].run(problem, np.random.default_rng(seed), stopping)
