"""Routes of fatigue damage and of virtual quantities."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Response
from pydantic_core import to_json

from slowtime_schemas.answers.fatigue import FatigueModel, VirtualModel
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.knowledge import Knowledge

from .twin_path import TwinId

_PROBLEMS = problems.answers({404: "No such twin", 422: "A parameter that is not valid"})
JSON = "application/json"


def routes(knowledge: Knowledge, known: Callable[[str], Awaitable[Registration]]) -> APIRouter:
    """Make them."""
    api = APIRouter(tags=["twins"])
    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/fatigue", response_model=FatigueModel, responses=_PROBLEMS)
    def fatigue(twin_id: TwinId, registration: Known) -> Response:
        """Fatigue damage of each point: Miner's sum, its course, and the time until failure."""
        body = to_json({"id": twin_id, "points": knowledge.fatigue(twin_id)})
        return Response(body, media_type=JSON)

    @api.get("/twins/{twin_id}/virtual", response_model=VirtualModel, responses=_PROBLEMS)
    def virtual(twin_id: TwinId, registration: Known) -> Response:
        """Virtual quantities of the latest windows, with standard deviations."""
        body = to_json({"id": twin_id, "windows": knowledge.virtual(twin_id)})
        return Response(body, media_type=JSON)

    return api
