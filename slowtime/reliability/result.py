"""Results of reliability methods, and confidence intervals of their estimates."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri, stdtrit

LEVEL = 0.95
TARGET = 0.05
"""Coefficient of variation at which sampling stops unless told otherwise."""


@dataclasses.dataclass(frozen=True, slots=True)
class Stopping:
    """When a sampling method stops.

    Parameters
    ----------
    variation
        Coefficient of variation of the probability that is aimed at.
    calls
        Calls of the limit state after which no more are made; the result then carries a
        warning.
    """

    variation: float = TARGET
    calls: int = 5_000_000

    def __post_init__(self) -> None:
        if not 0.0 < self.variation < 1.0:
            raise ValueError(
                f"variation={self.variation:g} is outside (0, 1). Give 0.05 for 5 %."
            )
        if self.calls < 1:
            raise ValueError(f"calls={self.calls} is not positive.")


@dataclasses.dataclass(frozen=True, slots=True)
class DesignPoint:
    r"""A point of the limit state that is nearest to the origin within its surroundings.

    Parameters
    ----------
    u
        In standard normal space.
    x
        The same point, in the units of the inputs.
    beta
        Signed distance from the origin; negative where the origin itself fails.
    alpha
        Unit vector with :math:`u^* = \beta \alpha`; its squares are the importances.
    converged
        Whether the search met its tolerance.
    mean_sensitivity, sd_sensitivity
        Input → :math:`\partial \beta / \partial \mu` and
        :math:`\partial \beta / \partial \sigma`, where the marginal is shifted along its axis
        or stretched about its mean [1 / unit of the input].
    """

    u: Float[np.ndarray, " input"]
    x: Float[np.ndarray, " input"]
    beta: float
    alpha: Float[np.ndarray, " input"]
    converged: bool = True
    mean_sensitivity: Mapping[str, float] = dataclasses.field(default_factory=dict)
    sd_sensitivity: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def importance(self) -> Float[np.ndarray, " input"]:
        r"""Share of each input in the variance of the linearised g, :math:`\alpha^2`."""
        return np.asarray(self.alpha**2)

    @property
    def probability(self) -> float:
        r"""Probability beyond the tangent plane, :math:`\Phi(-\beta)`."""
        return float(ndtr(-self.beta))


@dataclasses.dataclass(frozen=True, slots=True)
class Result:
    """Probability of failure as one method found it.

    Parameters
    ----------
    method
        Name of the method.
    probability
        The estimate.
    interval
        Ends of the 95 % interval, or None.
    no_interval
        Why there is no interval; empty where there is one.
    variation
        Coefficient of variation of the estimate; None for an approximation, infinite where
        nothing failed.
    calls
        Points at which the limit state was evaluated.
    design_points
        The nearest first; empty for methods that look for none.
    warnings
        What speaks against trusting the estimate, in sentences.
    bounds
        Bounds that hold whatever the joint failures are (`system`), or None.
    """

    method: str
    probability: float
    interval: tuple[float, float] | None
    no_interval: str
    variation: float | None
    calls: int
    design_points: tuple[DesignPoint, ...] = ()
    warnings: tuple[str, ...] = ()
    bounds: tuple[float, float] | None = None

    @property
    def beta(self) -> float:
        r"""Generalised reliability index :math:`\beta = -\Phi^{-1}(P_f)`."""
        return -float(ndtri(self.probability))


def sampled(
    method: str,
    probability: float,
    variation: float,
    calls: int,
    stopping: Stopping,
    *,
    design_points: tuple[DesignPoint, ...] = (),
    warnings: tuple[str, ...] = (),
    freedom: float = math.inf,
) -> Result:
    """Make the result of a sampling method; its interval is symmetric in the logarithm.

    `freedom` are the degrees of freedom of the variance, where few independent runs told it.
    """
    if probability <= 0.0 or not math.isfinite(variation):
        said = "No sampled point failed. Allow more calls, or use subset simulation."
        return Result(
            method, 0.0, None, "nothing failed", math.inf, calls, design_points,
            (*warnings, said),
        )  # fmt: skip
    wide = -stdtrit(freedom, 0.5 * (1.0 - LEVEL)) if math.isfinite(freedom) else ndtri(0.975)
    half = float(wide) * math.sqrt(math.log1p(variation**2))
    ends = probability * math.exp(-half), min(probability * math.exp(half), 1.0)
    if variation > stopping.variation:
        warnings = (*warnings, _short_of(variation, calls, stopping))
    return Result(
        method, min(probability, 1.0), ends, "", variation, calls, design_points, warnings
    )


def _short_of(variation: float, calls: int, stopping: Stopping) -> str:
    return (
        f"After {calls} calls the coefficient of variation is {variation:.2g}, not the "
        f"{stopping.variation:g} aimed at. Allow more calls, or use another method."
    )


def approximated(
    method: str,
    probability: float,
    calls: int,
    *,
    why: str,
    design_points: tuple[DesignPoint, ...] = (),
    warnings: tuple[str, ...] = (),
    bounds: tuple[float, float] | None = None,
) -> Result:
    """Make the result of a method whose error is not known: it has no interval.

    `why` says why there is no interval.
    """
    return Result(method, probability, None, why, None, calls, design_points, warnings, bounds)
