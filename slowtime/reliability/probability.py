"""What every method gives back, and how physical inputs become standard normal ones."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

LimitState: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Negative where the structure fails, at points [sample input]."""

LEVEL = 0.95


@dataclasses.dataclass(frozen=True, slots=True)
class Probability:
    """Probability of failure.

    Parameters
    ----------
    value
        The estimate.
    variation
        Its coefficient of variation: standard deviation over value; infinite where nothing
        failed.
    lo, hi
        Ends of its 95 % interval.
    calls
        Points at which the limit state was asked for.
    warnings
        What speaks against trusting it, in sentences.
    """

    value: float
    variation: float
    lo: float
    hi: float
    calls: int
    warnings: tuple[str, ...] = ()

    @property
    def reliability_index(self) -> float:
        r"""Generalised index :math:`\beta = -\Phi^{-1}(P_f)`."""
        return -float(ndtri(self.value))


def lognormal(
    value: float, variation: float, calls: int, warnings: tuple[str, ...] = ()
) -> Probability:
    """Estimate with an interval that is even in its logarithm: errors multiply."""
    if value <= 0.0 or not np.isfinite(variation):
        return Probability(value, np.inf, 0.0, 1.0, calls, warnings)
    half = float(ndtri(0.5 + 0.5 * LEVEL)) * float(np.sqrt(np.log1p(variation**2)))
    lo, hi = value * np.exp(-half), min(value * np.exp(half), 1.0)
    return Probability(value, variation, float(lo), float(hi), calls, warnings)


def physical(limit_state: LimitState, laws: Sequence[Any]) -> LimitState:
    """Limit state of standard normal inputs from one of independent inputs with given laws.

    Parameters
    ----------
    laws
        A frozen distribution of `scipy.stats` for each input.

    Examples
    --------
    >>> from scipy import stats
    >>> strength_over_load = physical(
    ...     lambda x: x[:, 0] - x[:, 1], [stats.norm(10.0, 1.0), stats.norm(5.0, 1.0)])
    >>> strength_over_load(np.zeros((1, 2)))
    array([5.])
    """

    def of_normal(u: Float[np.ndarray, "sample input"]) -> Float[np.ndarray, " sample"]:
        if u.shape[1] != len(laws):
            raise ValueError(
                f"{u.shape[1]} inputs were asked for of a limit state with {len(laws)} laws. "
                "Give one law for each input."
            )
        # Of large values the probability of exceeding keeps digits that that of staying loses.
        columns = [
            np.where(u[:, k] < 0.0, law.ppf(ndtr(u[:, k])), law.isf(ndtr(-u[:, k])))
            for k, law in enumerate(laws)
        ]
        return np.asarray(limit_state(np.stack(columns, axis=1)), dtype=float)

    return of_normal
