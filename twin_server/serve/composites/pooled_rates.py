"""Pools the drift rates of like members of a composite."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from slowtime.evolution.pooling import DriftRate, drift_rate, pool
from twin_server.history.states import ASSUMES_MASS, ASSUMES_STIFFNESS
from twin_server.serve.knowledge import Knowledge

MOST_READINGS = 500
"""Of one history; of a longer one, those that show what all of it shows."""

_ASSUMED = {"stiffness_change": ASSUMES_STIFFNESS, "mass_change": ASSUMES_MASS}


class Rates(NamedTuple):
    """Drift rates of one twin.

    Parameters
    ----------
    of
        Slope of each change with its standard deviation [1 per slow time].
    unit
        Of slow time.
    """

    of: Mapping[str, tuple[float, float]]
    unit: str | None = None


def pooled(facts: Mapping[str, Rates], twins: Sequence[str]) -> list[dict[str, Any]]:
    """Pool the drift rates of each change that at least one of some twins estimates."""
    found = [facts[twin_id] for twin_id in twins]
    return [
        _of_one(quantity, twins, [rates.get(quantity) for rates, _ in found], unit)
        for quantity in _ASSUMED
        if any(quantity in rates for rates, _ in found)
        for unit in [next((unit for rates, unit in found if quantity in rates), None)]
    ]


def rates_of(knowledge: Knowledge, twin_id: str) -> Rates:
    """Return the drift rates of a twin of which the readings tell one."""
    chapter = knowledge.history(twin_id, None, None, MOST_READINGS)
    states = chapter.states
    if not len(states):
        return Rates({})
    valid = states[states["reasons"] == 0]
    rates = {}
    for quantity, bit in _ASSUMED.items():
        used = valid[(valid["notes"] & bit) == 0]
        if not len(used):
            continue
        value, sd, _, _ = np.ascontiguousarray(used[quantity].T)
        seen = np.isfinite(value) & np.isfinite(sd)
        rate = drift_rate(np.ascontiguousarray(used["slow_time"])[seen], value[seen], sd[seen])
        if rate is not None and all(map(math.isfinite, rate)) and rate[1] > 0:
            rates[quantity] = rate
    return Rates(rates, chapter.units[-1] or None)


def _of_one(
    quantity: str,
    twins: Sequence[str],
    own: Sequence[tuple[float, float] | None],
    unit: str | None,
) -> dict[str, Any]:
    nothing = (math.nan, math.nan)
    rates, sds = np.array([one or nothing for one in own]).T.copy()
    found = pool(rates, sds)
    return {
        "quantity": quantity,
        "slow_time_unit": unit,
        "fleet": _rate(found.fleet),
        "spread": _rate(found.spread),
        "another": _rate(found.another),
        "members": [
            {
                "id": twin_id,
                **_rate(rate),
                "shrinkage": float(share),
                "own": None if alone is None else {"value": alone[0], "sd": alone[1]},
            }
            for twin_id, rate, share, alone in zip(
                twins, found.members, found.shrinkage, own, strict=True
            )
        ],
    }


def _rate(rate: DriftRate) -> dict[str, float | None]:
    """Convert to JSON, which has no infinity."""
    values = {"value": rate.value, "sd": rate.sd, "lo": rate.lo, "hi": rate.hi}
    return {name: one if math.isfinite(one) else None for name, one in values.items()}
