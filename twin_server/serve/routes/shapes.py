"""Route of a twin's mode shapes in space."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Response

from slowtime_schemas.answers.shapes import ShapesModel
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.instants import MomentText, moment_of
from twin_server.serve.knowledge import Knowledge
from twin_server.serve.state_rendering import json_response, shapes_of

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {404: "No such twin, or its model has no geometry", 422: "Not an instant"}
)


def routes(knowledge: Knowledge, known: Callable[[str], Awaitable[Registration]]) -> APIRouter:
    """Make the route; `known` returns the registration of the twin in the path."""
    api = APIRouter(tags=["twins"])
    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/shapes", response_model=ShapesModel, responses=_PROBLEMS)
    def shapes(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Nodes and lines of the model, with its mode shapes and the measured ones in space.

        The model is the one that the state of the latest epoch, or of the last one not later
        than `at`, says; measured shapes are those of the same epoch.
        """
        return json_response(shapes_of(knowledge, twin_id, moment_of("at", at)))

    return api
