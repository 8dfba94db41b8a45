"""Routes of alarms: list, acknowledge, test, and the state of their deliveries."""

from collections.abc import Awaitable, Callable, Sequence
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import ConfigDict, Field

from slowtime_schemas.answers import alarms as models
from slowtime_schemas.quantities import Immutable, Plain
from twin_server.events.deliveries import DeliveryTally
from twin_server.events.receivers import ReceiverName
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.state_rendering import json_response

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin, or no such alarm",
        409: "Not as things are",
        422: "A parameter or a body that is not valid",
    }
)

EventId = Annotated[
    str, Path(pattern=r"^[0-9a-f]{32}$", description="`event_id` of the alarm.")
]


class AcknowledgementOrder(Immutable):
    """Who acknowledges an alarm, with a comment."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"by": "Ann Moreau", "note": "On my way."}]}
    )

    by: Annotated[
        Annotated[str, Field(min_length=1, max_length=100), Plain] | None,
        Field(description="A name; by default that of the token."),
    ] = None
    note: Annotated[str, Field(max_length=1_000), Plain] = ""


class TestAlarmOrder(Immutable):
    """The receiver of a test alarm."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"receiver": "ops"}, {}]})

    receiver: Annotated[
        ReceiverName | None, Field(description="null for all receivers of the twin's routes.")
    ] = None


class AlarmService(Protocol):
    """Service of alarms; refusals are raised as `ProblemError`."""

    def alarms(self, twin_id: str, limit: int) -> list[dict[str, Any]]:
        """Return the newest alarms of a twin: whether raised, and acknowledgements."""
        ...

    def acknowledge(
        self, twin_id: str, event_id: str, by: str, principal: str, note: str
    ) -> dict[str, Any]:
        """Store an acknowledgement of an alarm."""
        ...

    def test(self, twin_id: str, receiver: str | None, by: str) -> dict[str, Any]:
        """Send a test event."""
        ...

    def deliveries(self, twin_id: str, limit: int) -> dict[str, Any]:
        """Return the state of a twin's routes, and its newest deliveries."""
        ...

    def tallies(self) -> Sequence[DeliveryTally]:
        """Count deliveries by twin, receiver and state."""
        ...


def routes(
    alarm_service: AlarmService, known: Callable[[str], Awaitable[Registration]]
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["alarms"])

    Known = Annotated[Registration, Depends(known)]
    Limit = Annotated[int, Query(ge=1, le=1_000)]

    @api.get("/twins/{twin_id}/alarms", response_model=models.AlarmList, responses=_PROBLEMS)
    def list_alarms(twin_id: TwinId, registration: Known, limit: Limit = 100) -> Response:
        """Alarms among the newest events: which hold still, and who has acknowledged them."""
        return json_response({"id": twin_id, "alarms": alarm_service.alarms(twin_id, limit)})

    @api.get(
        "/twins/{twin_id}/alarms/deliveries",
        response_model=models.DeliveryList,
        responses=_PROBLEMS,
    )
    def deliveries(twin_id: TwinId, registration: Known, limit: Limit = 100) -> Response:
        """Whom events have reached: what waits, was delivered or given up; last errors."""
        return json_response(alarm_service.deliveries(twin_id, limit))

    @api.post(
        "/twins/{twin_id}/alarms/test",
        status_code=202,
        response_model=models.TrialModel,
        responses=_PROBLEMS,
    )
    def test(
        request: Request, twin_id: TwinId, registration: Known, order: TestAlarmOrder
    ) -> Response:
        """Send a test alarm to the receivers of the twin's routes, or to one of them."""
        by = principal_of(request.scope).name
        return json_response(alarm_service.test(twin_id, order.receiver, by), 202)

    @api.post(
        "/twins/{twin_id}/alarms/{event_id}/acknowledge",
        response_model=models.AcknowledgedModel,
        responses=_PROBLEMS,
    )
    def acknowledge(
        request: Request,
        twin_id: TwinId,
        event_id: EventId,
        registration: Known,
        order: AcknowledgementOrder,
    ) -> Response:
        """Say that somebody has taken note of an alarm; it reminds nobody any more."""
        name = principal_of(request.scope).name
        by = order.by or name
        return json_response(alarm_service.acknowledge(twin_id, event_id, by, name, order.note))

    return api
