"""Assessments and limits → plain values for JSON and tables."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from slowtime.evolution.assessment import Assessment, DetectionLimit


def assessment_entry(found: Assessment, kinds: Mapping[str, str]) -> dict[str, Any]:
    """Turn an assessment into plain values.

    Parameters
    ----------
    found
        The assessment.
    kinds
        Name of each candidate → `member` or `connection`.

    Returns
    -------
    Values as JSON has them; numbers that are not known are None.
    """
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "p_value": _number(found.p_value),
        "other_p_value": _number(found.other_p_value),
        "sets": [
            [
                {
                    "name": one.name,
                    "kind": kinds[one.name],
                    "probability": one.probability,
                    "loss": one.loss,
                    "sd": one.sd,
                }
                for one in group.suspects
            ]
            for group in found.sets
        ],
        "probability": dict(found.probability),
        "common_change": {
            "value": _number(found.common_change[0]),
            "sd": _number(found.common_change[1]),
        },
        "modes": [
            {"before": one.before, "now": one.now, "mac": _number(one.mac)}
            for one in found.pairs
        ],
    }


CERTAIN = 0.95
"""Probability [1] from which a member is drawn as certain."""

INTERVAL = 1.96
"""Standard deviations of a 95 % interval [1]."""


def evidence_changes(
    sets: Sequence[Sequence[Mapping[str, Any]]], groups: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Change of each drawn member, the expected one: loss times probability.

    Parameters
    ----------
    sets
        Of `assessment_entry`: for each changed member, those that it may be.
    groups
        Members that are drawn.

    Returns
    -------
    Name → value, its standard deviation, and ends of its interval [1], which hold zero unless
    the member is certain.
    """
    nothing = {"value": 0.0, "sd": 0.0, "lo": 0.0, "hi": 0.0}
    changes = {name: dict(nothing) for name in groups}
    for one in (one for some in sets for one in some if one["name"] in changes):
        probability, loss, half = one["probability"], one["loss"], INTERVAL * one["sd"]
        expected = probability * loss
        spread = probability * (one["sd"] ** 2 + loss**2) - expected**2
        changes[one["name"]] = {
            "value": -expected,
            "sd": math.sqrt(max(spread, 0.0)),
            "lo": -min(loss + half, 1.0),
            "hi": -(loss - half) if probability >= CERTAIN else 0.0,
        }
    return changes


def limit_entries(
    limits: Sequence[DetectionLimit], kinds: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Turn limits into plain values; a loss is None where none is found.

    Parameters
    ----------
    limits
        The limits.
    kinds
        Name of each candidate → `member` or `connection`.

    Returns
    -------
    One entry for each.
    """
    return [
        {
            "name": one.name,
            "kind": kinds[one.name],
            "loss": _number(one.loss),
            "alike": list(one.alike),
        }
        for one in limits
    ]


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
