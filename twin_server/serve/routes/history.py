"""Routes of a twin's history: states, modes and its hash."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response
from fastapi.concurrency import run_in_threadpool

from slowtime_schemas.answers.history import HashModel, HistoryModel
from slowtime_schemas.answers.twins import (
    ModesModel,
)
from twin_server.history.rendering import points
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.instants import MomentText, moment_of
from twin_server.serve.knowledge import HistoryPart, Knowledge
from twin_server.serve.live import SHIFT
from twin_server.serve.state_rendering import json_response, modes_of, state_texts
from twin_server.settings import ServeSettings

from .twin_path import TwinId

JSON = "application/json"

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
    }
)

_POSITION = r"^[0-9A-Za-z._-]{0,64}:\d{1,12}$"

MANY_POINTS = 10_000
"""Points of one history from which on it takes a thread for long, and much memory."""


def routes(
    knowledge: Knowledge,
    settings: ServeSettings,
    known: Callable[[str], Awaitable[Registration]],
) -> APIRouter:
    """Make the routes; `known` returns the registration of the twin in the path."""
    api = APIRouter(tags=["twins"])
    reading = BoundedThreads(2)
    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/history", response_model=HistoryModel, responses=_PROBLEMS)
    async def history(
        twin_id: TwinId,
        registration: Known,
        start: MomentText = None,
        end: MomentText = None,
        max_points: Annotated[
            int,
            Query(ge=2, le=settings.max_points, description="Extremes are never left out."),
        ] = settings.default_points,
        shapes: Annotated[
            bool, Query(description="With the shapes of all modes, which are most of it.")
        ] = False,
        after: Annotated[
            str | None,
            Query(
                pattern=_POSITION,
                description="BOOT:SEQUENCE of a state: instead of a span, the `max_points` "
                "states that follow it, none left out; `:0` for the first ones.",
                examples=["20261121T035959Z-7f3a:812"],
            ),
        ] = None,
    ) -> Response:
        """States from `start` to `end`, both included, or all that follow one."""
        since, until = moment_of("start", start), moment_of("end", end)
        if after is not None and (since or until):
            raise ProblemError(
                422, "not-valid", "after was given with start or end. Give one or the other."
            )

        def history_document() -> bytes:
            if after is None:
                part = knowledge.history(twin_id, since, until, max_points)
            else:
                part = _following(knowledge, twin_id, after, max_points)
            objects = state_texts(twin_id, part, shapes=shapes)
            if part.bands is None:
                return points(objects)
            elements = registration.changes == "elements"
            names = registration.structure().free if elements else ()
            return points(objects, part.bands, part.units[-1], names)

        is_short = max_points <= MANY_POINTS
        body = await (
            run_in_threadpool(history_document) if is_short else reading.run(history_document)
        )
        return Response(body, media_type=JSON)

    @api.get("/twins/{twin_id}/modes", response_model=ModesModel, responses=_PROBLEMS)
    def modes(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Modes of the latest epoch, or of the last one not later than `at`, with shapes."""
        return json_response(modes_of(knowledge, twin_id, moment_of("at", at)))

    @api.get("/twins/{twin_id}/history/hash", response_model=HashModel, responses=_PROBLEMS)
    def history_hash(twin_id: TwinId, registration: Known) -> Response:
        """One number for a whole history: equal where the histories are, to the last bit."""
        digest, count = knowledge.digest(twin_id)
        return json_response({"id": twin_id, "sha256": digest, "features": count})

    return api


def _following(knowledge: Knowledge, twin_id: str, after: str, limit: int) -> HistoryPart:
    """Return the states that follow the one of a boot and a sequence."""
    boot, _, sequence = after.rpartition(":")
    number = knowledge.boot_number(twin_id, boot) if boot else 0
    if number is None:
        raise ProblemError(
            404,
            "no-such-boot",
            f"{twin_id} has no boot {boot:.64}. Give one of its history, or :0 to begin with "
            "the first state.",
        )
    return knowledge.since(twin_id, number << SHIFT | int(sequence) if boot else 0, limit)
