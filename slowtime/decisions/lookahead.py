"""One-step lookahead: repair now, inspect first, or wait, of one asset or of a whole fleet.

All that is asked of a model of degradation is the probability of a failure by each time, of a
few weighted states of each asset. What follows a renewal enters by its value V
(`continuation`), so that one step ahead is enough: repairing later is compared with the best
later repair, and each epoch asks anew.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .costs import FAILURE, REPAIR, Costs, discount
from .information import OUTCOMES, of_a_number, value_of_information


def repair_items(
    time: Float[np.ndarray, " time"],
    failure_cdf: Float[np.ndarray, "*asset path time"],
    costs: Costs,
    after_repair: Float[np.ndarray, "*#asset #path time item"],
    after_failure: Float[np.ndarray, "*#asset #path time item"],
) -> Float[np.ndarray, "*asset path time item"]:
    """Compute expected discounted items of a repair at each time, unless the asset fails first.

    Parameters
    ----------
    time
        When a repair may be planned, the first being now; not necessarily equal steps.
    failure_cdf
        Probability of a failure by each time, in each state.
    costs
        Costs of all items.
    after_repair, after_failure
        What follows a renewal at each time, until the horizon, not yet discounted to now.

    Returns
    -------
    Items of each planned time.
    """
    weight = discount(time, costs.discount_rate)[:, None]
    failing = np.diff(failure_cdf, axis=-1, prepend=0.0)[..., None]
    failures = np.cumsum(failing * weight * (costs.event(FAILURE) + after_failure), axis=-2)
    alive = (1.0 - failure_cdf)[..., None]
    return np.asarray(failures + alive * weight * (costs.event(REPAIR) + after_repair))


def never_items(
    time: Float[np.ndarray, " time"],
    failure_cdf: Float[np.ndarray, "*asset path time"],
    costs: Costs,
    after_failure: Float[np.ndarray, "*#asset #path time item"],
) -> Float[np.ndarray, "*asset path item"]:
    """Compute the expected discounted items where no repair is planned within the times.

    Parameters
    ----------
    time
        Times from now [time].
    failure_cdf
        Probability of a failure by each time [1].
    costs
        Costs, of which the discount rate and the items of a failure count.
    after_failure
        V after a failure at each time.
    """
    weight = discount(time, costs.discount_rate)[:, None]
    failing = np.diff(failure_cdf, axis=-1, prepend=0.0)[..., None]
    paid = failing * weight * (costs.event(FAILURE) + after_failure)
    return np.asarray(paid.sum(axis=-2))


@dataclasses.dataclass(frozen=True, slots=True)
class Monitored:
    """Readings that come by a later time anyway, or an inspection that may be made then.

    Parameters
    ----------
    action
        Index of the first action that is left then.
    sd
        Error with which they tell, together, in which state the asset is now [1].
    cost
        Of it, discounted [currency].
    """

    action: int
    sd: Float[np.ndarray, " asset"]
    cost: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Lookahead:
    """What each asset should do now.

    Parameters
    ----------
    repair, inspect
        Whether to repair now, or to inspect now and decide by what is found.
    repair_cost, wait_cost, inspect_cost
        Expected cost of each: repairing now, at the best later time or never, inspecting first
        [currency].
    when
        Index of the best time of a repair; the count of times for none.
    net_value
        Value of an inspection now minus its cost [currency]; -infinite where none is offered.
        It is the lesser of two: against all plans made without further knowledge, and against
        repairing now or later only.
    """

    repair: Bool[np.ndarray, " asset"]
    inspect: Bool[np.ndarray, " asset"]
    repair_cost: Float[np.ndarray, " asset"]
    wait_cost: Float[np.ndarray, " asset"]
    inspect_cost: Float[np.ndarray, " asset"]
    when: Int[np.ndarray, " asset"]
    net_value: Float[np.ndarray, " asset"]


def look_ahead(
    cost: Float[np.ndarray, "asset path action"],
    weights: Float[np.ndarray, "asset path"],
    damage: Float[np.ndarray, "asset path"] | None = None,
    *,
    inspection_sd: float = 0.0,
    inspection_cost: float = np.inf,
    monitored: Sequence[Monitored] = (),
    outcomes: int = OUTCOMES,
) -> Lookahead:
    """Choose for each asset; the first action is to repair now, the others are later.

    Parameters
    ----------
    cost
        Of a repair at each time, in each state [currency].
    weights
        Of each state; their sum is 1.
    damage
        Of each state now, which an inspection measures [1]; None to offer no inspection.
    inspection_sd, inspection_cost
        Error of an inspection [1], and what one costs [currency].
    monitored
        Readings that come anyway, and later inspections: waiting may end by what they tell.
    outcomes
        Number of intervals of a measured number.

    Returns
    -------
    Choice for each asset, with its expected costs [currency].
    """
    expected = (weights[..., None] * cost).sum(axis=-2)
    now, later = expected[:, 0], expected[:, 1:].min(axis=-1)
    inspected, resolved = np.full(len(expected), np.inf), np.full(len(expected), -np.inf)
    if damage is not None:
        # Perfect information is worth at least as much: most assets need nothing more.
        perfect = expected.min(axis=-1) - (weights * cost.min(axis=-1)).sum(axis=-1)
        close = np.flatnonzero((now <= later) | (perfect > inspection_cost))
        some = cost[close], weights[close], damage[close]
        for one in monitored:
            of_all = np.broadcast_to(one.sd, now.shape)[close]
            told = _informed(some, of_all, one.action, outcomes)
            later[close] = np.minimum(later[close], told + one.cost)
        if np.isfinite(inspection_cost):
            of_all = np.full(len(close), inspection_sd)
            inspected[close] = _informed(some, of_all, 0, outcomes) + inspection_cost
            value = _resolved(some, later[close], of_all, outcomes)
            resolved[close] = value - inspection_cost
    net = np.minimum(np.minimum(now, later) - inspected, resolved)
    inspect = net > 0.0
    repair = ~inspect & (now <= later)
    return Lookahead(repair, inspect, now, later, inspected, expected.argmin(axis=-1), net)


def _resolved(
    some: tuple[
        Float[np.ndarray, "asset path action"],
        Float[np.ndarray, "asset path"],
        Float[np.ndarray, "asset path"],
    ],
    later: Float[np.ndarray, " asset"],
    sd: Float[np.ndarray, " asset"],
    outcomes: int,
) -> Float[np.ndarray, " asset"]:
    """Give the value of an observation for what is done now.

    Repairs that are planned far ahead will be planned anew by the readings until then: an
    inspection is not worth what it saves on them. Waiting therefore costs in each state what
    the best later repair does, all of them shifted so that their mean is `later`.
    """
    cost, weights, damage = some
    waiting = cost[..., 1:].min(axis=-1)
    waiting = waiting + (later - (weights * waiting).sum(axis=-1))[:, None]
    now_or_later = np.stack([cost[..., 0], waiting], axis=-1)
    likelihood = of_a_number(damage, weights, sd, outcomes)
    return value_of_information(now_or_later, weights, likelihood).value


def _informed(
    some: tuple[
        Float[np.ndarray, "asset path action"],
        Float[np.ndarray, "asset path"],
        Float[np.ndarray, "asset path"],
    ],
    sd: Float[np.ndarray, " asset"],
    action: int,
    outcomes: int,
) -> Float[np.ndarray, " asset"]:
    """Give the expected cost where it is chosen among the actions from one on, informed."""
    cost, weights, damage = some
    likelihood = of_a_number(damage, weights, sd, outcomes)
    told = value_of_information(cost[..., action:], weights, likelihood)
    return np.asarray(told.prior - told.value)
