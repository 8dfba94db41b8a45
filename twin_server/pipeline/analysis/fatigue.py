"""Adds up the fatigue of all boots of a twin: damage, its course and the remaining life.

A message says what has come since its boot began. The newest of each boot therefore counts, and
the boots add up: a message that comes twice, late or after others changes nothing.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from slowtime.fatigue.histogram import Histogram
from slowtime.fatigue.miner import Capacity, MinerSum, TimeToFailure
from slowtime_schemas.messages import Fatigue, FatiguePoint

LEVEL = 0.95
"""Probability of the intervals that are told."""
QUANTILES = (0.05, 0.5, 0.95)
FEWEST_HOURS = 3
"""Hours of damage from which the rate is given a deviation of its own; before, it is taken for
known to within `UNKNOWN_RATE`."""
UNKNOWN_RATE = 1.0
"""Coefficient of variation of a rate that fewer hours tell [1]."""


def fatigue_of(messages: Sequence[Fatigue]) -> list[dict[str, Any]]:
    """Add up the boots of a twin.

    Parameters
    ----------
    messages
        In the order of time; several of a boot are its course.
    """
    names = dict.fromkeys(point.name for message in messages for point in message.points)
    return [_point(name, messages) for name in names]


def _point(name: str, messages: Sequence[Fatigue]) -> dict[str, Any]:
    newest: dict[str, FatiguePoint] = {}
    course: list[dict[str, float]] = []
    for message in messages:
        for point in message.points:
            if point.name == name:
                before = newest.get(message.boot)
                if before is None or point.seconds >= before.seconds:
                    newest[message.boot] = point
                course.append(_moment(message.t_ns, newest.values()))
    points = list(newest.values())
    total, last = _sum(points), points[-1]
    seconds = sum(point.seconds for point in points)
    mine = [m for m in messages if any(point.name == name for point in m.points)]
    span = (max(m.t_ns for m in mine) - min(m.start_ns for m in mine)) / 1e9
    rate = total.median / seconds if seconds else 0.0
    low, high = total.interval(LEVEL)
    variation = _variation(course)
    left = TimeToFailure.of(total, rate, rate_variation=variation)
    reasons = dict.fromkeys(reason for point in points for reason in point.reasons)
    if len({(point.unit, point.curve) for point in points}) > 1:
        reasons["curve_changed"] = None
    histogram = Histogram.total(
        Histogram(dict(zip(point.bins, point.half_cycles, strict=True))) for point in points
    )
    return {
        "name": name,
        "unit": last.unit,
        "source": last.source,
        "damage": {"value": total.median, "sd": total.sd, "lo": low, "hi": high},
        "damage_per_year": rate * 365.25 * 86_400,
        "rate_variation": variation,
        "counted_s": seconds,
        "uncounted_s": max(0.0, span - seconds),
        "boots": len(points),
        "time_to_failure_s": {
            f"{100 * p:g} %": value if math.isfinite(value := left.quantile(p)) else None
            for p in QUANTILES
        },
        "failed_probability": left.used_up if total.median > 0 else 0.0,
        "capacity": {"median": Capacity().median, "variation": Capacity().variation},
        "curve": last.curve.model_dump(),
        "reasons": list(reasons),
        "course": course,
        "ranges": histogram.ranges.tolist(),
        "cycles": histogram.counts.tolist(),
    }


def _sum(points: Sequence[FatiguePoint]) -> MinerSum:
    """Add sums whose scatter is fully correlated, as it comes from the same specimens."""
    damage = sum(point.damage for point in points)
    weights = [point.damage / damage if damage else 1 / len(points) for point in points]
    return MinerSum(
        median=damage,
        ln_sd=sum(w * p.ln_sd for w, p in zip(weights, points, strict=True)),
        slope=sum(w * p.slope for w, p in zip(weights, points, strict=True)),
    )


def _moment(t_ns: int, points: Any) -> dict[str, float]:
    total = _sum(list(points))
    low, high = total.interval(LEVEL)
    seconds = sum(point.seconds for point in points)
    return {"t_ns": t_ns, "damage": total.median, "lo": low, "hi": high, "seconds": seconds}


def _variation(course: Sequence[dict[str, float]]) -> float:
    """Coefficient of variation of the mean rate, from hour to hour."""
    damage = np.diff([0.0] + [moment["damage"] for moment in course])
    seconds = np.diff([0.0] + [moment["seconds"] for moment in course])
    whole = seconds > 0
    if whole.sum() < FEWEST_HOURS:
        return UNKNOWN_RATE
    rates, weights = damage[whole] / seconds[whole], seconds[whole] / seconds[whole].sum()
    mean = float(weights @ rates)
    if mean <= 0:
        return UNKNOWN_RATE
    spread = float(weights @ (rates - mean) ** 2) / (whole.sum() - 1)
    return math.sqrt(spread) / mean
