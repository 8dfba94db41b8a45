"""Routes of events of assets: record and list repairs, replacements, inspections and notes."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Request, Response

from slowtime_schemas.answers.asset_events import AssetEventList, AssetEventModel
from twin_server.events.asset_events import AssetEventOrder
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.state_rendering import json_response

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        409: "Another event has this id, or there is no such event to take back",
        422: "A body that is not valid, or does not fit the twin",
    }
)


class AssetEventService(Protocol):
    """Service of events of assets; refusals are raised as `ProblemError`."""

    def record(
        self, twin_id: str, registration: Registration, order: AssetEventOrder, principal: str
    ) -> tuple[dict[str, Any], bool]:
        """Record an event; return the stored event, and whether it is new."""
        ...

    def listed(self, twin_id: str) -> dict[str, Any]:
        """Return all events of an asset, the newest first, and the questions about it."""
        ...


def routes(
    asset_event_service: AssetEventService, known: Callable[[str], Awaitable[Registration]]
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["events"])
    recording = BoundedThreads(2)

    Known = Annotated[Registration, Depends(known)]

    @api.post(
        "/twins/{twin_id}/events",
        status_code=201,
        response_model=AssetEventModel,
        responses={
            200: {"model": AssetEventModel, "description": "It was recorded already"},
            **_PROBLEMS,
        },
    )
    async def record(
        request: Request, twin_id: TwinId, registration: Known, order: AssetEventOrder
    ) -> Response:
        """Record a repair, replacement, inspection, load test or note.

        The forecast restarts from a repair. The same event twice is one event; a note with
        `reverses` takes an event back.
        """
        name = principal_of(request.scope).name
        told, new = await recording.run(
            lambda: asset_event_service.record(twin_id, registration, order, name)
        )
        return json_response(told, 201 if new else 200)

    @api.get(
        "/twins/{twin_id}/events/recorded",
        response_model=AssetEventList,
        responses=_PROBLEMS,
    )
    async def recorded(twin_id: TwinId, registration: Known) -> Response:
        """List what people have recorded, and the questions whether something was repaired."""
        return json_response(await recording.run(lambda: asset_event_service.listed(twin_id)))

    return api
