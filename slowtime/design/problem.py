"""A design problem: design variables, random inputs, an objective and limit states."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.reliability import Problem

Variables: TypeAlias = Float[np.ndarray, "sample variable"]
Inputs: TypeAlias = Float[np.ndarray, "sample input"]
Function: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From design variables [sample variable] and inputs [sample input], row by row, to values
[sample]."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A quantity that the designer chooses between two bounds.

    Parameters
    ----------
    lower, upper
        Bounds, in the unit of the variable.
    start
        The design to compare with; the lower bound (nothing added) if None.
    """

    lower: float
    upper: float
    start: float | None = None

    def __post_init__(self) -> None:
        if not -np.inf < self.lower < self.upper < np.inf:
            raise ValueError(
                f"Bounds {self.lower:g} to {self.upper:g} were given. Give finite bounds, the "
                "lower one first."
            )
        if self.start is not None and not self.lower <= self.start <= self.upper:
            raise ValueError(
                f"start={self.start:g} is outside the bounds {self.lower:g} to "
                f"{self.upper:g}. Give a value between them, or leave it out."
            )

    @property
    def begin(self) -> float:
        """The design to compare with."""
        return self.lower if self.start is None else self.start


@dataclasses.dataclass(frozen=True, slots=True)
class Constraint:
    r"""A limit state and the largest probability of failure that is accepted.

    Parameters
    ----------
    limit_state
        :math:`g(d, x)`; failure where it is at most 0.
    probability
        :math:`p^*`, between 0 and 0.5.
    """

    limit_state: Function
    probability: float

    def __post_init__(self) -> None:
        if not 0.0 < self.probability <= 0.5:
            raise ValueError(
                f"probability={self.probability:g} was given. Give the accepted probability of "
                "failure, above 0 and at most 0.5."
            )


@dataclasses.dataclass(frozen=True)
class DesignProblem:
    r"""Minimise :math:`\alpha\,\mu/\mu^* + (1-\alpha)\,\sigma/\sigma^*` (eq. 4.18).

    Parameters
    ----------
    variables
        Name → bounds.
    inputs
        Random inputs with their dependence: a `Problem`, whose own limit state is not used.
    objective
        :math:`c(d, x)`, of which :math:`\mu` and :math:`\sigma` are the mean and the standard
        deviation over the inputs.
    constraints
        Name → limit state with its accepted probability.
    alpha
        Weight of the mean; 1 ignores the spread, 0 the mean.

    Raises
    ------
    ValueError
        Without variables, or with `alpha` outside [0, 1].
    """

    variables: Mapping[str, Variable]
    inputs: Problem
    objective: Function
    constraints: Mapping[str, Constraint] = dataclasses.field(default_factory=dict)
    alpha: float = 1.0

    def __post_init__(self) -> None:
        if not self.variables:
            raise ValueError("A design without variables has nothing to choose. Give one.")
        if not 0.0 <= self.alpha <= 1.0:
            raise ValueError(
                f"alpha={self.alpha:g} is outside [0, 1]. Give 1 for the mean alone, 0 for the "
                "standard deviation alone."
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables, in order."""
        return tuple(self.variables)

    @property
    def lower(self) -> Float[np.ndarray, " variable"]:
        """Lower bounds."""
        return np.array([one.lower for one in self.variables.values()])

    @property
    def width(self) -> Float[np.ndarray, " variable"]:
        """Upper bounds less the lower ones."""
        return np.array([one.upper - one.lower for one in self.variables.values()])

    @property
    def begin(self) -> Float[np.ndarray, " variable"]:
        """The design to compare with."""
        return np.array([one.begin for one in self.variables.values()])

    def reliability(self, name: str, design: Float[np.ndarray, " variable"]) -> Problem:
        """Make the reliability problem of one constraint at a design.

        Parameters
        ----------
        name
            Name of the constraint.
        design
            Design variables, in their units.

        Returns
        -------
        The reliability problem.
        """
        limit_state = self.constraints[name].limit_state

        def at_design(x: np.ndarray) -> np.ndarray:
            return limit_state(np.broadcast_to(design, (len(x), len(design))), x)

        return dataclasses.replace(self.inputs, limit_state=at_design)


def values_of(
    function: Function, d: Variables, x: Inputs, what: str
) -> Float[np.ndarray, " sample"]:
    """Evaluate a function of design and inputs, and check its values.

    Parameters
    ----------
    function
        Function of design variables and inputs.
    d
        Design variables of each row, in their units.
    x
        Inputs of each row, in their units.
    what
        Name of the function in messages.

    Returns
    -------
    Values, in the unit of the function.

    Raises
    ------
    ValueError
        For another shape than one value a row, or for NaN.
    """
    values = np.asarray(function(d, x), dtype=float)
    if values.shape != (len(d),):
        raise ValueError(
            f"{what} returned shape {values.shape} for {len(d)} rows. Return one value a row."
        )
    if np.isnan(values).any():
        raise ValueError(
            f"{what} is NaN at the design {np.array2string(d[int(np.isnan(values).argmax())])}."
            " Narrow the bounds of the variables, or repair the formula."
        )
    return values
