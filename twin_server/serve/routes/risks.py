"""Routes of the failure probability of a twin."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic import Field
from pydantic_core import to_json

from slowtime_schemas.answers import risks as risk_models
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.knowledge import Knowledge

from .twin_path import OfForecast, TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
        429: "More than your site or token may have under way",
        503: "Too many wait already; `Retry-After` says when to come back",
    }
)
Finite = Annotated[float, Field(gt=0, le=1e300, allow_inf_nan=False)]


def routes(
    knowledge: Knowledge, known: Callable[[str], Awaitable[Registration]], queue: ComputeQueue
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

    @api.get("/twins/{twin_id}/risk", response_model=risk_models.RiskModel, responses=_PROBLEMS)
    async def risk(
        request: Request,
        twin_id: TwinId,
        registration: Known,
        horizon: Annotated[
            Finite | None,
            Query(description="How far ahead, in slow time; by default as the forecast."),
        ] = None,
        since: OfForecast = None,
    ) -> Response:
        """Tell how probable failure is by each limit state: now, in the past and to come.

        Of the registration's `limit_states`, and of the forecast after the last reading;
        `docs/risk.md` describes how.
        """
        body = await queue.run(
            request,
            lambda: to_json(knowledge.risk(twin_id, horizon, since)),
            group=("risk", twin_id),
            share=("risk", twin_id, registration, horizon, since),
            light=True,
        )
        return Response(body, media_type="application/json")

    return api
