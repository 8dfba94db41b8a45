"""Puts the scores of a twin's past outlooks into an answer, and into sentences."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from slowtime_schemas.slow_times import time_in_words
from twin_server.estimate.forecast.statements import (
    QuantityScore,
    Verification,
    told_quantiles,
)
from twin_server.registration.thresholds import shown

from .past_outlooks import Scored

SHOWN = 0.95
"""Central interval whose coverage is put into words [1]: that of the bands."""

SAID = 1.02
"""Factor from which a wider spread is told in words [1]: less is not seen in a band."""

NONE = (
    "No outlook of this twin has been kept yet. The first one is kept after 16 readings, once "
    "somebody has asked for the forecast or a limit is registered."
)


def record_answer(twin_id: str, verified: Scored | None, unit: str | None) -> dict[str, Any]:
    """Return the past outlooks of a twin with their scores, as REST does.

    Parameters
    ----------
    verified
        Kept outlooks and scores; None where there are none.
    unit
        Of slow time.
    """
    head: dict[str, Any] = {"id": twin_id, "since": None, "slow_time_unit": unit}
    if verified is None:
        none: dict[str, Any] = {
            "count": 0,
            "came_true": 0,
            "effective": 0.0,
            "brier": None,
            "classes": [],
        }
        empty: dict[str, Any] = {"quantities": {}, "outlooks": [], "sentences": []}
        return {**head, "kept": 0, **empty, "thresholds": none, "reasons": [NONE]}
    scores = verified.scores
    quantities = {
        name: _quantity(name, one, verified.widening.get(name, {}))
        for name, one in scores.quantities.items()
    }
    thresholds = _thresholds(scores)
    sentences = [said for one in quantities.values() for said in one["sentences"]]
    return {
        **head,
        "since": verified.since,
        "kept": len(verified.statements),
        "quantities": quantities,
        "thresholds": thresholds,
        "outlooks": [_outlook(one) for one in verified.statements],
        "sentences": [*thresholds["sentences"], *sentences],
        "reasons": []
        if any(one["coverage"][0]["count"] for one in quantities.values())
        else [
            f"No kept outlook can be compared with what came up to "
            f"{time_in_words(verified.since, unit)}. Wait for more readings."
        ],
    }


def _quantity(name: str, score: QuantityScore, widening: Mapping[str, Any]) -> dict[str, Any]:
    words = shown(name)[0]
    coverage = [dataclasses.asdict(one) for one in score.coverage]
    bands = next(one for one in score.coverage if one.stated == SHOWN)
    sentences = []
    if bands.count:
        sentences.append(
            f"{words}: of {bands.count} values foretold, {bands.held} lay within their "
            f"{100 * SHOWN:.0f} % bands ({100 * bands.held / bands.count:.0f} %; they overlap, "
            f"and count as {score.widening.effective:.1f} independent ones: "
            f"{100 * bands.lo:.0f} to {100 * bands.hi:.0f} %)."
        )
    factor = widening.get("factor", 1.0)
    if factor >= SAID:
        sentences.append(
            f"{words}: its futures are spread {factor:.2f} times wider than its laws say, "
            "because what came lay further from past outlooks than they stated (a wrong spread "
            f"has a probability of {100 * widening['probability']:.0f} %)."
        )
    return {"coverage": coverage, "widening": dict(widening), "sentences": sentences}


def _thresholds(scores: Verification) -> dict[str, Any]:
    count = len(scores.decided)
    came = sum(one.came_true for one in scores.decided)
    sentences = []
    if count:
        sentences.append(
            f"Of {count} statements on thresholds whose horizon has passed, {came} came true; "
            f"{sum(one.stated for one in scores.decided):.1f} were expected to. Their Brier "
            f"score is {scores.brier:.3f}; they overlap, and count as {scores.effective:.1f} "
            "independent ones."
        )
    return {
        "count": count,
        "came_true": came,
        "effective": scores.effective,
        "brier": scores.brier,
        "classes": [dataclasses.asdict(one) for one in scores.classes],
        "sentences": sentences,
    }


def _outlook(stated: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "since": stated["since"],
        "horizon": stated["horizon"],
        "quantities": {
            name: {
                "instants": one["instants"],
                "quantiles": told_quantiles(one).tolist(),
                "widening": one["widening"],
            }
            for name, one in stated["quantities"].items()
        },
        "crossings": stated["crossings"],
    }
