"""Routes of events and of the live stream."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Request, Response

from slowtime_schemas.answers.history import EventList
from twin_server.fairness import OverQuotaError
from twin_server.history.rendering import event_object
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.http.quotas import over_quota
from twin_server.serve.knowledge import Knowledge
from twin_server.serve.live import Hub, LiveResponse
from twin_server.serve.state_rendering import json_response

from .twin_path import TwinId

RETRY_AFTER_S = 5
"""What a client is told to wait where too many watch [s]."""

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
    }
)


def routes(
    knowledge: Knowledge, hub: Hub, known: Callable[[str], Awaitable[Registration]]
) -> APIRouter:
    """Make the routes; `known` returns the registration of the twin in the path."""
    api = APIRouter(tags=["twins"])
    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/events", response_model=EventList, responses=_PROBLEMS)
    def events(
        twin_id: TwinId,
        registration: Known,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=10_000)] = 100,
    ) -> Response:
        """List the newest events; with `after`, those that follow the one of that number."""
        found = knowledge.events(twin_id, after=after or 0, limit=limit, newest=after is None)
        return json_response({"events": [event_object(*event) for event in found]})

    @api.get(
        "/twins/{twin_id}/live",
        response_class=Response,
        responses={
            200: {
                "description": "Server-sent events `state`, `event` and `reset`. Resumable.",
                "content": {"text/event-stream": {}},
            },
            **_PROBLEMS,
            **problems.answers(
                {429: "More than your site or token may have under way", 503: "Too many watch"}
            ),
        },
    )
    async def live(
        twin_id: TwinId,
        registration: Known,
        request: Request,
        last_event_id: Annotated[str | None, Header()] = None,
    ) -> Response:
        """States and events as they become durable; `Last-Event-ID` brings what was missed."""
        principal = principal_of(request.scope)
        try:
            client = hub.join(twin_id)
        except OverQuotaError as error:
            raise over_quota(error, RETRY_AFTER_S, "too-many-clients") from error
        if client is None:
            raise ProblemError(503, "not-ready", "The server is ending. Try again later.")
        return LiveResponse(hub, client, knowledge, last_event_id, principal.still)

    return api
