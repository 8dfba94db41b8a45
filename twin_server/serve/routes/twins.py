"""Routes of twins: list, register, read and delete."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import ConfigDict
from pydantic_core import from_json, to_json

from slowtime_schemas.answers.base import RestAnswer
from slowtime_schemas.answers.twins import (
    CONCLUSION_EXAMPLE,
    ELEMENTS_EXAMPLE,
    STATE_EXAMPLE,
    TwinStatus,
)
from twin_server.identity.principals import principal_of
from twin_server.registration.changes import Author
from twin_server.registration.twin import MODEL_EXAMPLE, Registration
from twin_server.serve.composite_service import CompositeService
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.instants import Moment, MomentText, moment_of
from twin_server.serve.knowledge import Knowledge
from twin_server.serve.state_rendering import no_state, state_texts

from .twin_path import TwinId

JSON = "application/json"

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
    }
)


class TwinModel(TwinStatus):
    """A twin: its registration, and its latest state or that at an instant."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    **STATE_EXAMPLE,
                    "conclusion": {"answer": "no", "findings": [], "next": None},
                    "alive": True,
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "registration": {"changes": "stiffness"},
                },
                {
                    **ELEMENTS_EXAMPLE,
                    "conclusion": CONCLUSION_EXAMPLE,
                    "alive": False,
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "registration": MODEL_EXAMPLE,
                },
            ]
        }
    )

    registration: Registration


class TwinList(RestAnswer):
    """All twins."""

    twins: tuple[TwinModel, ...]


def routes(
    knowledge: Knowledge,
    known: Callable[[str], Awaitable[Registration]],
    changing: BoundedThreads,
    composite_service: CompositeService | None = None,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path.
    changing
        Threads in which twins are registered and deleted.
    composite_service
        Says which ids are those of composites, and is told of each twin that was deleted.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["twins"])
    listing = BoundedThreads(2)
    Known = Annotated[Registration, Depends(known)]

    def described(
        twin_id: str, registration: Registration, at: Moment | None, *, shapes: bool = True
    ) -> str:
        return _described(knowledge, twin_id, registration, at, shapes=shapes)

    @api.get("/twins", response_model=TwinList)
    async def list_twins(request: Request) -> Response:
        """All twins, each with its latest state; shapes are left to `modes`."""

        def listed() -> bytes:
            seen = knowledge.ids(principal_of(request.scope))
            all_of_them = [(i, knowledge.registration(i)) for i in seen]
            texts = [
                described(i, r, None, shapes=False) for i, r in all_of_them if r is not None
            ]
            return f'{{"twins":[{",".join(texts)}]}}'.encode()

        return Response(await listing.run(listed), media_type=JSON)

    @api.put(
        "/twins/{twin_id}",
        response_model=TwinModel,
        responses={201: {"model": TwinModel}, **_PROBLEMS},
    )
    async def register(
        request: Request, twin_id: TwinId, registration: Registration
    ) -> Response:
        """Register a twin, or register it anew: its history is then estimated again."""
        release_body_slot(request.scope)
        if composite_service is not None and composite_service.exists(twin_id):
            raise composite_of_that_id(twin_id)
        name = principal_of(request.scope).name
        author = Author(name, name)
        new = await changing.run(lambda: knowledge.register(twin_id, registration, author))
        told = await run_in_threadpool(described, twin_id, registration, None)
        return Response(told, 201 if new else 200, media_type=JSON)

    @api.get("/twins/{twin_id}", response_model=TwinModel, responses=_PROBLEMS)
    def one_twin(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Show a twin with its latest state, or the last one not later than `at`."""
        moment = moment_of("at", at)
        return Response(described(twin_id, registration, moment), media_type=JSON)

    @api.delete("/twins/{twin_id}", status_code=204, responses=_PROBLEMS)
    async def delete(twin_id: TwinId, registration: Known) -> Response:
        """Forget a twin and its history. While its edge publishes, a new one is begun."""
        existed = await changing.run(lambda: knowledge.delete(twin_id))
        if existed and composite_service is not None:
            await run_in_threadpool(composite_service.note_deleted_twin, twin_id)
        return Response(status_code=204)

    return api


def composite_of_that_id(twin_id: str) -> ProblemError:
    """Make the refusal of a twin whose id is that of a composite."""
    return ProblemError(
        409,
        "is-a-composite",
        f"{twin_id} is a composite. Give the twin another id, or delete the composite.",
    )


def _described(
    knowledge: Knowledge,
    twin_id: str,
    registration: Registration,
    at: Moment | None,
    *,
    shapes: bool,
) -> str:
    """Render a twin with its latest state, or that at an instant."""
    part = knowledge.latest(twin_id, at)
    found = state_texts(twin_id, part, shapes=shapes)
    state = next(found, None) or no_state(twin_id, at)
    reasons = int(part.states["reasons"][-1]) if len(part.states) else None
    body = from_json(part.bodies[-1] or b"{}") if part.bodies else {}
    more = to_json(
        {
            # What is known now says nothing of another instant.
            "conclusion": None
            if at is not None
            else knowledge.conclusion(twin_id, reasons, body.get("suspects", ())),
            "alive": knowledge.alive(twin_id),
            "heard_ns": knowledge.heard_ns(twin_id),
            "aside": knowledge.aside(twin_id),
            "sensor": knowledge.sensor(twin_id),
            "link": knowledge.link(twin_id),
            "raised": knowledge.raised(twin_id),
            "nominal": knowledge.nominal(twin_id),
            "normal": knowledge.normal(twin_id),
            "registration": registration.to_dict(),
        }
    ).decode()
    return f"{state[:-1]},{more[1:]}"
