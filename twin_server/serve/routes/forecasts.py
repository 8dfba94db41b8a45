"""Routes of forecasts: bands of each quantity, and the times of reaching thresholds."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic import Field
from pydantic_core import to_json

from slowtime.degradation import RemainingLife
from slowtime_schemas.answers.forecasts import ForecastModel, TrackRecordModel
from twin_server.history.rendering import estimate_objects
from twin_server.registration.thresholds import Limit, shown, signed
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.instants import Moment, MomentText, moment_of
from twin_server.serve.knowledge import Knowledge
from twin_server.settings import ServeSettings

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
        429: "More than your site or token may have under way",
        503: "Too many wait already; `Retry-After` says when to come back",
    }
)
_OF_THE_WHOLE = ("stiffness_change", "mass_change")
_TOO_FEW = (
    "There are too few valid readings to forecast from. Wait for more of them, or look at the "
    "reasons of the latest states."
)

CDF_POINTS, CDF_SHARES = 21, np.linspace(0.025, 0.975, 39)
"""Points of the distribution function of a remaining life: times evenly up to the horizon, and
the times of these probabilities, so that a steep one is told as well [1]."""

QUANTILES = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95)
"""Probabilities whose times are told of a remaining life [1]."""

TOLD = 0.005
"""Posterior probability from which a degradation law is told [1]."""

Finite = Annotated[float, Field(gt=0, le=1e300, allow_inf_nan=False)]
Change = Annotated[float, Field(ge=-1.0, le=1e6, allow_inf_nan=False)]
Side = Literal["below", "above"]


def routes(
    knowledge: Knowledge,
    settings: ServeSettings,
    known: Callable[[str], Awaitable[Registration]],
    queue: ComputeQueue,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    queue
        Where it is waited for what takes long.
    """
    api = APIRouter(tags=["twins"])

    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/forecast", response_model=ForecastModel, responses=_PROBLEMS)
    async def forecast(
        request: Request,
        twin_id: TwinId,
        registration: Known,
        horizon: Annotated[
            Finite | None,
            Query(
                description="How far ahead, in slow time; by default as registered, or as "
                "long as the past."
            ),
        ] = None,
        count: Annotated[
            int, Query(alias="points", ge=1, le=settings.max_forecast_points)
        ] = 40,
        threshold: Annotated[
            Change | None,
            Query(
                description="When is this change reached? Beside those of the registration.",
                examples=[-0.2],
            ),
        ] = None,
        quantity: Annotated[
            str | None,
            Query(description="Of which quantity; needed where several are estimated."),
        ] = None,
        toward: Annotated[
            Side | None, Query(description="By default the side where it is not now.")
        ] = None,
        at: MomentText = None,
    ) -> Response:
        """Stiffness and mass change, or each element's, up to `horizon` after the last.

        With `at`, as it would have been foretold at that moment, from what came until then.

        And of each threshold the distribution of the time at which it is first reached:
        distribution function, quantiles, what lies beyond the horizon, and the degradation
        laws that it follows from, with their weights.
        """
        moment = moment_of("at", at)
        asked = _thresholds(registration, threshold, quantity, toward)

        def foretold() -> bytes:
            return to_json(_forecast(knowledge, twin_id, horizon, count, asked, moment))

        # Of one twin one at a time: what the first has learnt is there for the others.
        body = await queue.run(
            request,
            foretold,
            group=twin_id,
            share=(twin_id, registration, horizon, count, tuple(asked), moment),
            light=moment is None,
        )
        return Response(body, media_type="application/json")

    @api.get(
        "/twins/{twin_id}/forecast/record",
        response_model=TrackRecordModel,
        responses=_PROBLEMS,
    )
    async def record(request: Request, twin_id: TwinId, registration: Known) -> Response:
        """Past outlooks of a twin, and what came of them: coverage, reliability, Brier score.

        The truth is the change as all later readings show it. A statement on a threshold
        counts once its horizon has passed.
        """
        body = await queue.run(
            request,
            lambda: to_json(knowledge.track_record(twin_id)),
            group=twin_id,
            share=("record", twin_id, registration),
            light=True,
        )
        return Response(body, media_type="application/json")

    return api


def foretell(
    knowledge: Knowledge,
    twin_id: str,
    registration: Registration,
    horizon: float | None = None,
    count: int = 40,
    *,
    threshold: float | None = None,
    quantity: str | None = None,
    toward: Side | None = None,
    at: Moment | None = None,
) -> dict[str, Any]:
    """Return the forecast as REST does.

    Raises
    ------
    ProblemError
        Where a threshold is of nothing that is estimated.
    """
    asked = _thresholds(registration, threshold, quantity, toward)
    return _forecast(knowledge, twin_id, horizon, count, asked, at)


def _thresholds(
    registration: Registration,
    threshold: float | None,
    quantity: str | None,
    toward: Side | None,
) -> list[tuple[str, Limit]]:
    """All thresholds with a crossing time, and where each comes from."""
    asked: list[tuple[str, Limit]] = []
    if threshold is not None:
        name = _quantity(registration, quantity)
        asked.append(("request", Limit(name, threshold, toward)))
    elif quantity is not None or toward is not None:
        raise ProblemError(
            422,
            "not-valid",
            "quantity or toward was given without a threshold. Give threshold as well, such "
            "as threshold=-0.2.",
        )
    for limit in registration.thresholds():
        asked.append(("registration" if limit.toward is None else "alarm", limit))
    return asked


def _quantity(registration: Registration, given: str | None) -> str:
    """Return the quantity of a threshold."""
    if registration.changes == "elements":
        allowed: Sequence[str] = registration.structure().free
    else:
        both = registration.changes == "both"
        allowed = _OF_THE_WHOLE if both else (f"{registration.changes}_change",)
    if given is None and len(allowed) == 1:
        return allowed[0]
    if given is None or given not in allowed:
        raise ProblemError(
            422,
            "not-valid",
            f"At query.quantity, {given!r:.80} was given. Allowed: {', '.join(allowed)}.",
        )
    return given


def _forecast(
    knowledge: Knowledge,
    twin_id: str,
    horizon: float | None,
    count: int,
    asked: Sequence[tuple[str, Limit]],
    at: Moment | None,
) -> dict[str, Any]:
    outlook = knowledge.outlook(twin_id, horizon, count, [limit for _, limit in asked], at)
    if outlook is None:
        none = dict.fromkeys(("since", "horizon", "until", "slow_time_unit"))
        empty: dict[str, Any] = {"points": [], "crossings": [], "periods": {}, "jumps": {}}
        return {
            "id": twin_id,
            **none,
            **empty,
            "valid": False,
            "reasons": [_TOO_FEW],
            "warnings": [],
            "widening": {},
            "record": [],
        }
    rows = [None] * len(outlook.slow_time)
    of_each = {name: estimate_objects(band.tolist()) for name, band in outlook.bands.items()}
    elements = [name for name in of_each if name not in _OF_THE_WHOLE]
    sources = {limit: source for source, limit in reversed(asked)}
    # Of the past nothing is told of what came later.
    record = knowledge.track_record(twin_id) if at is None else None
    return {
        "id": twin_id,
        "since": outlook.since,
        "horizon": outlook.horizon,
        "until": outlook.until,
        "slow_time_unit": outlook.unit,
        "points": [
            {
                "slow_time": time,
                **{name: of_each.get(name, rows)[row] for name in _OF_THE_WHOLE},
                "elements": {name: of_each[name][row] for name in elements},
            }
            for row, time in enumerate(outlook.slow_time.tolist())
        ],
        "crossings": [
            _crossing(sources[limit], limit, life, outlook.since)
            | {"record": _record_of(record, life.within)}
            for limit, life in outlook.crossings
        ],
        "periods": outlook.periods,
        "jumps": outlook.jumps,
        "valid": not outlook.reasons,
        "reasons": list(outlook.reasons),
        "warnings": list(outlook.misfits),
        "widening": dict(outlook.widening),
        "record": [] if record is None else record["sentences"],
    }


def _record_of(record: dict[str, Any] | None, stated: float) -> dict[str, Any] | None:
    """Past statements of about the same probability; None where none has been decided."""
    for one in record["thresholds"]["classes"] if record is not None else ():
        if one["low"] <= stated < one["high"] or stated == one["high"] == 1.0:
            found: dict[str, Any] = one
            return found
    return None


def _crossing(source: str, limit: Limit, life: RemainingLife, since: float) -> dict[str, Any]:
    side = "at" if limit.toward is None else limit.toward
    words, unit, times = shown(limit.quantity)
    steep = life.quantile(CDF_SHARES)
    grid = np.linspace(life.now, life.horizon, CDF_POINTS)
    grid = np.unique(np.concatenate([grid, steep[np.isfinite(steep)]]))
    return {
        "quantity": limit.quantity,
        "threshold": limit.at,
        "toward": limit.toward,
        "source": source,
        "times": [
            {"share": share, **_when(at, since)}
            for share, at in zip(life.shares, life.slow_time.tolist(), strict=True)
        ],
        "quantiles": [
            {"share": share, **_when(at, since)}
            for share, at in zip(
                QUANTILES, life.quantile(np.array(QUANTILES)).tolist(), strict=True
            )
        ],
        "median": _when(life.median, since)["slow_time"],
        "cdf": {"slow_time": grid.tolist(), "probability": life.cdf(grid).tolist()},
        "within": life.within,
        "beyond": life.beyond,
        "already": life.already,
        "horizon": life.horizon,
        "laws": {name: share for name, share in _sorted(life.weights) if share >= TOLD},
        "sentence": f"{words} {side} {signed(times * limit.at)} {unit}: {life.words()}",
    }


def _when(at: float, since: float) -> dict[str, float | None]:
    finite = bool(np.isfinite(at))
    return {"slow_time": at if finite else None, "ahead": at - since if finite else None}


def _sorted(weights: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(weights.items(), key=lambda item: -item[1])
