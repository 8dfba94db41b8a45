r"""The last time at which a repair may be ordered: by the probability of failing, or by cost.

By probability: :math:`\tau^* = e^* - \ell`, with :math:`e^*` the last accessible time for which
:math:`P(T < e^*)` is at most the accepted probability. By cost: :math:`e^*` is where the
expected cost of a planned repair is least; after it the cost rises.
"""

import dataclasses
import math
from typing import Literal

import numpy as np
from jaxtyping import Float

from .access import Access

SIDE = 1.645
"""Standard deviations [1] of the ends of a 90 % interval of a normal number."""

FLAT = 1e-9
"""Relative difference of costs [1] that is rounding."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class LastOrder:
    """The last order of a repair that is in time.

    Parameters
    ----------
    order
        Its time from now: negative where it has passed, minus infinity where no window opens
        in time, infinite where nothing needs to be ordered within the horizon [time].
    low, high
        5 and 95 % ends of it, by the sampling error of the futures [time].
    effect
        When the repair takes effect that is ordered then [time].
    probability
        Of a failure before that effect [1].
    by
        What it is judged by.
    limit
        Accepted probability of a failure before the effect [1]; None by cost.
    now_effect, now_probability
        Of a repair that is ordered now [time, 1].
    """

    order: float
    low: float
    high: float
    effect: float
    probability: float
    by: Literal["probability", "cost"]
    limit: float | None
    now_effect: float
    now_probability: float


def last_order_by_probability(
    failure_time: Float[np.ndarray, " path"],
    weights: Float[np.ndarray, " path"],
    access: Access,
    limit: float,
) -> LastOrder:
    """Find the last order by which a failure before the effect stays below a limit.

    Parameters
    ----------
    failure_time
        Of each future, infinite for none [time].
    weights
        Weight of each future; their sum is 1.
    access
        Lead time and windows.
    limit
        Accepted probability [1].

    Returns
    -------
    The last order; its ends from the standard error of a weighted share.

    Raises
    ------
    ValueError
        Where the limit is not a probability between 0 and 1.
    """
    if not 0.0 < limit < 1.0:
        raise ValueError(
            f"An accepted probability of {limit:g} was given. Give one between 0 and 1."
        )
    order = np.argsort(failure_time, kind="stable")
    total = np.cumsum(weights[order])
    error = SIDE * math.sqrt(limit * (1.0 - limit) * float(np.sum(weights**2)))

    times = np.append(failure_time[order], np.inf)

    def last_effect(share: float) -> float:
        at = times[np.searchsorted(total, share * (1 + FLAT), side="right")]
        # Beyond the horizon nothing is known of failures: nothing needs to be ordered yet.
        return float(access.closing(np.array([at]))[0]) if np.isfinite(at) else math.inf

    ends = last_effect(max(limit - error, 0.0)), last_effect(limit), last_effect(limit + error)
    return _last(ends, (failure_time, weights), access, by="probability", limit=limit)


def last_order_by_cost(
    time: Float[np.ndarray, " time"],
    cost: Float[np.ndarray, "path plan"],
    failure_time: Float[np.ndarray, " path"],
    weights: Float[np.ndarray, " path"],
    access: Access,
) -> LastOrder:
    """Find the last order before the expected cost of a planned repair rises.

    Parameters
    ----------
    time
        Equal steps from 0 [time].
    cost
        Of a repair that takes effect at each time, and of none (the last column), in each
        future [currency].
    failure_time
        Of each future, infinite for none [time].
    weights
        Weight of each future; their sum is 1.
    access
        Lead time and windows.

    Returns
    -------
    The last order; its ends are those between which the expected cost differs from the least by
    no more than its sampling error.
    """
    effect = access.effect_times(time, lead=False)
    places = np.append(np.flatnonzero(np.isfinite(effect)), len(time))
    some = cost[:, places]
    mean = weights @ some
    within = np.flatnonzero(mean <= mean.min() + FLAT * max(abs(float(mean.min())), 1e-300))
    best = int(within[-1])
    apart = some - some[:, best : best + 1]
    error = np.sqrt(np.sum((weights[:, None] * (apart - weights @ apart)) ** 2, axis=0))
    same = (weights @ apart) <= SIDE * error
    later = np.append(np.flatnonzero(~same[best:]), len(places) - best)[0] + best - 1
    sooner = best - np.append(np.flatnonzero(~same[best::-1]), best + 1)[0] + 1
    at = np.append(effect, np.inf)[places]
    ends = (float(at[sooner]), float(at[best]), float(at[later]))
    return _last(ends, (failure_time, weights), access, by="cost", limit=None)


def _last(
    effects: tuple[float, float, float],
    futures: tuple[Float[np.ndarray, " path"], Float[np.ndarray, " path"]],
    access: Access,
    *,
    by: Literal["probability", "cost"],
    limit: float | None,
) -> LastOrder:
    failure_time, weights = futures

    def fails_before(at: float) -> float:
        return float(weights @ (failure_time < at))

    now = access.effect(0.0)
    low, middle, high = effects
    return LastOrder(
        order=middle - access.lead,
        low=low - access.lead,
        high=high - access.lead,
        effect=middle,
        probability=fails_before(middle),
        by=by,
        limit=limit,
        now_effect=now,
        now_probability=fails_before(now),
    )
