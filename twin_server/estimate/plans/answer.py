"""Renders a plan as REST gives it: amounts, bands, times and sentences."""

import dataclasses
import datetime
import math
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.decisions import Option, Plan, Worth
from slowtime.decisions.option import band
from slowtime_schemas.slow_times import LAST_CLOCK_S
from twin_server.registration.costs import SECONDS, CostTable

from .plan import Planned, PlanOrder, plan_of
from .wording import (
    TimeWording,
    changes_of,
    last_order_sentence,
    option_words,
    sentence_of,
    worth_words,
)

CURVE = 41
"""Times of each curve that are told."""

READINGS = 200
"""Readings that are told with a plan at most [1]: more cannot be told apart in a picture."""


def plan_answer(twin_id: str, order: PlanOrder) -> dict[str, Any]:
    """Make the plan of a twin, and write it as REST gives it.

    Raises
    ------
    NotPlannableError
        Where the owner's times cannot be converted.
    """
    return answer_of_plan(twin_id, order, plan_of(order))


def answer_of_plan(twin_id: str, order: PlanOrder, made: Planned) -> dict[str, Any]:
    """Write a plan as REST gives it."""
    plan, costs, since_ns = made.plan, order.costs, order.since_ns
    seconds = _seconds(order)
    ahead = not plan.futures.access.is_immediate
    when = TimeWording(costs.time_unit, since_ns, seconds, order.unit, ahead)
    clock = _Clock(order.laws.now, made.slow_per_unit, since_ns, seconds)
    rows = np.unique(np.round(np.linspace(0, len(plan.futures.time) - 1, CURVE)).astype(int))
    failure, ranking = order.decision.failure, plan.ranking
    best = option_words(plan.best, when)
    other = None if ranking.other is None else plan.options[ranking.other]
    return {
        "id": twin_id,
        "name": order.name,
        "since": order.laws.now,
        "currency": costs.currency,
        "costs": _costs(costs),
        "months": list(order.decision.access.months),
        "time_unit": costs.time_unit,
        "slow_time_unit": order.unit,
        "seconds": seconds,
        "horizon": clock.at(plan.futures.horizon),
        "failure": {
            "quantity": failure.quantity,
            "threshold": failure.at,
            "toward": "above" if failure.below is None else "below",
            "already": float(plan.failure_probability[0]),
            "within": float(plan.failure_probability[-1]),
            "estimate": _present(plan, failure.at),
        },
        "action": plan.best.now if ranking.is_known else "undecided",
        "decided": ranking.is_known,
        "sentence": sentence_of(plan, costs.currency, when),
        "last_order": _last_order(plan, order.decision.lead_time, when, clock),
        "changes": changes_of(plan, costs.currency, when),
        "options": [
            _option(plan, row, order, when, clock, rows) for row in range(len(plan.options))
        ],
        "times": [clock.at(float(plan.futures.time[row])) for row in rows.tolist()],
        "history": _history(order, made.slow_per_unit),
        "outlook": _outlook(plan, failure.at, rows),
        "repair_cost": plan.repair_cost[rows].tolist(),
        "failure_probability": plan.failure_probability[rows].tolist(),
        "difference": None
        if other is None
        else {
            "best": best,
            "other": option_words(other, when),
            "value": ranking.difference,
            "lo": ranking.low,
            "hi": ranking.high,
        },
        "break_even": [
            {"item": one.item, "given": one.given, "at": one.at} for one in ranking.break_even
        ],
        "information": [_worth(one, order, when, clock) for one in plan.worths],
        "inspections": [_worth(one, order, when, clock) for one in plan.inspections],
        "valid": True,
        "reasons": [],
    }


def refusal_of(twin_id: str, reason: str, name: str = "") -> dict[str, Any]:
    """Render the reason why there is no plan yet."""
    nothing = dict.fromkeys(
        (
            "since",
            "currency",
            "costs",
            "time_unit",
            "slow_time_unit",
            "seconds",
            "horizon",
            "failure",
            "last_order",
            "action",
        )
    )
    empty: dict[str, Any] = {
        name: []
        for name in (
            "months", "changes", "options", "times", "history", "outlook", "repair_cost",
            "failure_probability", "break_even", "information", "inspections",
        )
    }  # fmt: skip
    nothing["difference"] = None
    told = {"decided": False, "sentence": reason, "valid": False, "reasons": [reason]}
    return {"id": twin_id, "name": name, **nothing, **empty, **told}


def _present(plan: Plan, limit: float) -> dict[str, float]:
    """Estimate the quantity that fails at the last reading, from where its futures begin."""
    now, weights = plan.futures.damage[:, 0] * limit, plan.futures.weights
    mean = float(weights @ now)
    return {"value": mean, "sd": math.sqrt(float(weights @ (now - mean) ** 2))}


def _history(order: PlanOrder, slow_per_unit: float) -> list[dict[str, float]]:
    """Give the readings of the quantity that fails, evenly thinned up to the last."""
    if order.past is None:
        return []
    past, every = order.past, math.ceil(len(order.past.slow_time) / READINGS)
    ahead = (past.slow_time - order.laws.now) / slow_per_unit
    columns = (column[::-1][::every][::-1].tolist() for column in (ahead, past.value, past.sd))
    return [
        {"ahead": at, "value": value, "sd": sd}
        for at, value, sd in zip(*columns, strict=True)
        if math.isfinite(value) and math.isfinite(sd)
    ]


def _outlook(plan: Plan, limit: float, rows: Any) -> list[dict[str, float]]:
    """Give median and band of the futures of the quantity that fails."""
    futures, found = plan.futures.damage[:, rows] * limit, []
    for values in futures.T:
        order = np.argsort(values)
        total = np.cumsum(plan.futures.weights[order])
        places = np.minimum(np.searchsorted(total, (0.05, 0.5, 0.95)), len(order) - 1)
        lo, value, hi = values[order][places].tolist()
        found.append({"value": value, "lo": lo, "hi": hi})
    return found


def _costs(table: CostTable) -> dict[str, Any]:
    """Render all that the owner pays for, as REST gives it."""
    return dataclasses.asdict(table.costs())


class _Clock:
    """Times from now in slow time and, where it is known, in the calendar."""

    def __init__(
        self, since: float, slow: float, since_ns: int | None, seconds: float | None
    ) -> None:
        self._since, self._slow = since, slow
        self._since_ns, self._seconds = since_ns, seconds

    def at(self, time: float) -> dict[str, Any]:
        moment = None
        if self._since_ns is not None and self._seconds is not None:
            at_s = self._since_ns / 1e9 + time * self._seconds
            if 0 <= at_s < LAST_CLOCK_S:
                whole = datetime.datetime.fromtimestamp(at_s, datetime.UTC)
                moment = whole.isoformat(timespec="seconds")
        return {"ahead": time, "slow_time": self._since + time * self._slow, "t": moment}


def _seconds(order: PlanOrder) -> float | None:
    unit = order.costs.time_unit
    return order.pace if unit == "slow_time" else SECONDS[unit]


def _option(
    plan: Plan,
    row: int,
    order: PlanOrder,
    when: TimeWording,
    clock: _Clock,
    rows: Any,
) -> dict[str, Any]:
    option, prices = plan.options[row], order.costs.costs().prices()
    low, high = band(option.items @ prices, plan.futures.weights)
    return {
        "name": option.name,
        "words": option_words(option, when),
        "now": option.now,
        "cost": {"value": float(plan.costs[row]), "lo": low, "hi": high},
        "failures": float(option.quantities(plan.futures.weights)[0]),
        "parameters": dict(option.parameters),
        "repair": _times(option, plan.futures.weights, clock),
        "curve": (option.curve[rows] @ prices).tolist(),
    }


def _last_order(
    plan: Plan, lead_time: float, when: TimeWording, clock: _Clock
) -> dict[str, Any]:
    last = plan.last_order

    def told(time: float) -> dict[str, Any] | None:
        return clock.at(time) if np.isfinite(time) else None

    passed = last.order < 0.0
    return {
        "status": "passed" if passed else "due" if np.isfinite(last.order) else "beyond",
        "order": told(last.order),
        "lo": told(last.low),
        "hi": told(last.high),
        "effect": told(last.effect),
        "probability": last.probability,
        "by": last.by,
        "limit": last.limit,
        "now_effect": told(last.now_effect),
        "now_probability": last.now_probability,
        "lead_time": lead_time,
        "sentence": last_order_sentence(plan, when),
    }


def _times(
    option: Option, weights: Float[np.ndarray, " path"], clock: _Clock
) -> list[dict[str, Any] | None] | None:
    """Return times by which 5, 50 and 95 % of the futures are repaired; None if unknown."""
    if option.repair_time is None:
        return None
    order = np.argsort(option.repair_time)
    total = np.cumsum(weights[order])
    places = [
        min(int(np.searchsorted(total, share)), len(order) - 1) for share in (0.05, 0.5, 0.95)
    ]
    times = [float(option.repair_time[order][place]) for place in places]
    return [clock.at(time) if np.isfinite(time) else None for time in times]


def _worth(worth: Worth, order: PlanOrder, when: TimeWording, clock: _Clock) -> dict[str, Any]:
    return {
        "name": worth.observation.name,
        "kind": worth.observation.kind,
        "at": clock.at(worth.at),
        "count": worth.observation.count,
        "cost": worth.observation.cost,
        "value": worth.value,
        "net": worth.net,
        "changes": worth.changes,
        "words": worth_words(worth, order.costs.currency, when),
    }
