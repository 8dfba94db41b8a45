"""Health and failure probability of a composite, from those of its members."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slowtime.reliability.trees import analyse, any_dependence, band, members
from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import below, groups_of, tree_of, twins_of

from .facts import FailureQuestion, TwinFacts
from .failure import Failure, unknown
from .pooled_rates import pooled

Composites = Mapping[str, Composite]


def health(facts: Mapping[str, Mapping[str, Any]], twins: Sequence[str]) -> dict[str, Any]:
    """Aggregate the health of twins: valid where all of them are.

    Parameters
    ----------
    facts
        The health of each twin, as `TwinFacts` tells it.
    """
    each = [facts[twin_id] for twin_id in twins]
    return {
        "twins": len(each),
        "alive": sum(one["alive"] for one in each),
        "valid_twins": sum(one["valid"] for one in each),
        "valid": all(one["valid"] for one in each),
        "alarms": sum(len(one["alarms"]) for one in each),
        "reasons": [f"{one['id']}: {reason}" for one in each for reason in one["reasons"]],
    }


def assess(
    facts: TwinFacts,
    composites: Composites,
    composite_id: str,
    horizon: float | None = None,
) -> dict[str, Any]:
    """Return health, failure probability, importance and rates of a composite.

    Parameters
    ----------
    facts
        About the twins within.
    horizon
        How far ahead, in slow time; by default that of the registration, or else the shortest
        of its twins' forecasts.
    """
    wanted = composites[composite_id]
    twins = twins_of(composite_id, composites)
    asked = wanted.horizon if horizon is None else horizon
    failures, ahead, unit = _failures(facts, composites, composite_id, asked)
    healths = facts.health(twins)
    told = _failure_of(composite_id, composites, failures)
    tree, groups = tree_of(composite_id, composites), groups_of(composite_id, composites)
    leaves = members(tree)
    known = {name: failures[name].value for name in leaves}
    importance = (
        analyse(tree, known, groups).importance
        if not any(map(math.isnan, known.values()))
        else {}
    )
    of_twins = [
        healths[name]
        | {
            "failure": _as_json(failures[name]),
            "importance": {
                key: _number(getattr(importance[name], key))
                for key in ("birnbaum", "criticality", "fussell_vesely")
            }
            if name in importance
            else None,
        }
        for name in twins
    ]
    reasons = [reason for name in leaves for reason in failures[name].reasons]
    return {
        "id": composite_id,
        "name": wanted.name or composite_id,
        "kind": wanted.kind,
        "registration": wanted.to_dict(),
        "health": health(healths, twins) | {"worst": _worst(of_twins)},
        "failure": {
            **told,
            "horizon": ahead,
            "slow_time_unit": unit,
            "reasons": reasons,
        },
        "tree": wanted.whole_tree.model_dump(mode="json", exclude_none=True),
        "members": [_member(healths, composites, name, failures) for name in wanted.members],
        "twins": of_twins,
        "pooled": pooled(facts.rates(like := alike(wanted, composites)), like),
    }


def alike(wanted: Composite, composites: Composites) -> list[str]:
    """Name the members whose drift rates are pooled."""
    if wanted.alike is not None:
        return [name for name in wanted.alike if name not in composites]
    if wanted.kind != "line":
        return []
    return [name for name in wanted.members if name not in composites]


def _failures(
    facts: TwinFacts, composites: Composites, composite_id: str, horizon: float | None
) -> tuple[dict[str, Failure], float | None, str | None]:
    """Failure probability of each twin up to one horizon; the horizon, and its unit."""
    twins = twins_of(composite_id, composites)
    failing = {
        name: one
        for composite in (*reversed(below(composite_id, composites)), composite_id)
        for name, one in composites[composite].failing.items()
    }
    found = facts.failures(
        {name: FailureQuestion(horizon, failing.get(name)) for name in twins}
    )
    units = [one.unit for one in found.values() if one.horizon is not None]
    unit = max(units, key=units.count) if units else None
    for name, one in found.items():
        if one.horizon is not None and one.unit != unit:
            found[name] = unknown(
                f"{name} counts slow time in {one.unit or 'no unit'}, most others in "
                f"{unit or 'no unit'}: there is no common horizon."
            )
    ahead = [one.horizon for one in found.values() if one.horizon is not None]
    shortest = min(ahead, default=horizon)
    if horizon is None and shortest is not None and max(ahead) > shortest:
        again = {
            name: FailureQuestion(shortest, failing.get(name))
            for name, one in found.items()
            if one.horizon is not None and one.horizon > shortest
        }
        found |= facts.failures(again)
    return found, shortest, unit


def _failure_of(
    composite_id: str, composites: Composites, failures: Mapping[str, Failure]
) -> dict[str, Any]:
    """Failure probability of a composite, its band and its bounds."""
    tree, groups = tree_of(composite_id, composites), groups_of(composite_id, composites)
    leaves = members(tree)
    bands = {
        name: (failures[name].value, failures[name].lo, failures[name].hi) for name in leaves
    }
    # The same composite gets the same numbers, so that its band does not flicker.
    seed = int.from_bytes(hashlib.sha256(composite_id.encode()).digest()[:8], "big")
    found = band(tree, bands, np.random.default_rng(seed), groups)
    lowest = any_dependence(tree, {name: one[1] for name, one in bands.items()})[0]
    highest = any_dependence(tree, {name: one[2] for name, one in bands.items()})[1]
    return {
        "value": _number(found.value),
        "lo": found.lo,
        "hi": found.hi,
        "lowest": found.lowest,
        "highest": found.highest,
        "any_dependence": {"lo": lowest, "hi": highest},
    }


def _member(
    healths: Mapping[str, Mapping[str, Any]],
    composites: Composites,
    name: str,
    failures: Mapping[str, Failure],
) -> dict[str, Any]:
    """Describe a direct member: a twin, or a composite with the twins within it."""
    if name not in composites:
        return {
            "id": name,
            "kind": "twin",
            "valid": healths[name]["valid"],
            "failure": _as_json(failures[name]),
        }
    twins = twins_of(name, composites)
    told = _failure_of(name, composites, failures)
    return {
        "id": name,
        "kind": composites[name].kind,
        "valid": health(healths, twins)["valid"],
        "failure": {key: told[key] for key in ("value", "lo", "hi")},
    }


def _worst(twins: Sequence[Mapping[str, Any]]) -> str | None:
    """Name the twin that accounts for most of the failures, or else the likeliest to fail."""
    by_share = [
        (one["importance"]["criticality"] or 0.0, one["failure"]["value"] or 0.0, one["id"])
        for one in twins
        if one["importance"] is not None
    ]
    by_chance = [
        (one["failure"]["value"], 0.0, one["id"])
        for one in twins
        if one["failure"]["value"] is not None
    ]
    best = max(by_share or by_chance, key=lambda one: one[:2], default=None)
    return None if best is None or best[:2] == (0.0, 0.0) else best[2]


def _as_json(failure: Failure) -> dict[str, Any]:
    return {
        "value": _number(failure.value),
        "lo": failure.lo,
        "hi": failure.hi,
        "reasons": list(failure.reasons),
        "since": failure.since,
        "horizon": None
        if failure.since is None or failure.horizon is None
        else failure.since + failure.horizon,
    }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
