"""What a design optimisation returns."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.reliability import Result


@dataclasses.dataclass(frozen=True, slots=True)
class Verified:
    """One constraint at one design, by a sampling method.

    Parameters
    ----------
    accepted
        Largest probability of failure that is accepted.
    found
        Probability of failure with its interval.
    """

    accepted: float
    found: Result

    @property
    def met(self) -> bool | None:
        """Whether the probability is at most the accepted one; None within sampling error."""
        if self.found.interval is None:
            return self.found.probability <= self.accepted
        lo, hi = self.found.interval
        if hi <= self.accepted:
            return True
        return False if lo > self.accepted else None


@dataclasses.dataclass(frozen=True, slots=True)
class Evaluated:
    """A design with what it costs and how safe it is.

    Parameters
    ----------
    variables
        Values, in the order of the problem's variables.
    value
        Objective of eq. (4.18).
    mean, sd
        Mean and standard deviation of the objective over the inputs, in its own unit.
    constraints
        Name → probability of failure beside the accepted one.
    """

    variables: Float[np.ndarray, " variable"]
    value: float
    mean: float
    sd: float
    constraints: Mapping[str, Verified]

    @property
    def feasible(self) -> bool:
        """Whether no constraint is violated beyond sampling error."""
        return all(one.met is not False for one in self.constraints.values())


@dataclasses.dataclass(frozen=True, slots=True)
class Design:
    """The best design found, beside the one it was compared with.

    Parameters
    ----------
    names
        Of the variables.
    alpha
        Weight of the mean in the objective.
    reference
        Mean and standard deviation that the objective is divided by.
    start, best
        The design to compare with, and the best one.
    bounds
        Name of each variable that ended at a bound → ``"lower"`` or ``"upper"``.
    rounds
        Alternations of optimisation and search for worst points.
    calls
        Rows at which the functions of the problem were evaluated, those of a surrogate not
        counted.
    warnings
        What speaks against trusting the design, in sentences.
    """

    names: tuple[str, ...]
    alpha: float
    reference: tuple[float, float]
    start: Evaluated
    best: Evaluated
    bounds: Mapping[str, str]
    rounds: int
    calls: int
    warnings: tuple[str, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether the best design meets every constraint."""
        return self.best.feasible
