"""Routes of changes of twins: change fields, correct an event, undo, and list all changes."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Request, Response
from pydantic_core import to_json

from slowtime_schemas.twin_changes import TwinChange, TwinChangeOrder, TwinChanges
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.document_route import DocumentRoute

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        409: "Other values hold by now, nothing would change, or there is no such change",
        422: "A body that is not valid, or values that do not fit the twin",
    }
)


class TwinChangeService(Protocol):
    """Service of changes of twins; refusals are raised as `ProblemError`."""

    def change(self, twin_id: str, order: TwinChangeOrder, principal: str) -> dict[str, Any]:
        """Change fields of a registration or of a recorded event; return the stored change."""
        ...

    def listed(self, twin_id: str) -> dict[str, Any]:
        """Return the changes of a registration and of recorded events, the newest first."""
        ...


def routes(
    service: TwinChangeService,
    known: Callable[[str], Awaitable[Registration]],
    changing: BoundedThreads,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    changing
        Threads in which twins are registered and deleted.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["twins"])
    listing = BoundedThreads(2)
    Known = Annotated[Registration, Depends(known)]

    @api.post(
        "/twins/{twin_id}/changes",
        status_code=201,
        response_model=TwinChange,
        responses=_PROBLEMS,
    )
    async def change(
        request: Request, twin_id: TwinId, registration: Known, order: TwinChangeOrder
    ) -> Response:
        """Change alarms, forecast, costs and such of a twin, correct an event, or undo it.

        With `before`, only if those values still hold. The history is estimated again where
        alarms or `confirm_readings` change. With `event`, that recorded event is taken back and
        a corrected one recorded instead of it, in one step; both are kept.
        """
        release_body_slot(request.scope)
        name = principal_of(request.scope).name
        told = await changing.run(lambda: service.change(twin_id, order, name))
        return Response(to_json(told), 201, media_type="application/json")

    @api.get("/twins/{twin_id}/changes", response_model=TwinChanges, responses=_PROBLEMS)
    async def changes(twin_id: TwinId, registration: Known) -> Response:
        """List who changed registration or recorded events, and each field before and after."""
        told = await listing.run(lambda: service.listed(twin_id))
        return Response(to_json(told), media_type="application/json")

    return api
