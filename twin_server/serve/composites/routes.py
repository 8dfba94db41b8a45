"""Routes of composites: register, list, assess, and list their members and events."""

import itertools
from collections.abc import Awaitable, Callable, Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic_core import to_json

from slowtime_schemas.answers import composites as models
from slowtime_schemas.answers.history import EventList
from slowtime_schemas.quantities import Plain
from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import (
    WrongCompositeError,
    above,
    check_tree,
    memberships,
    twins_of,
)
from twin_server.history.rendering import event_object
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import ID, Registration
from twin_server.serve.composite_service import CompositeService, out_of_reach
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.routes.twin_path import TwinId

from .assessment import assess, health
from .facts import TwinFacts

JSON = "application/json"
_PROBLEMS = problems.answers(
    {
        403: "A member of a site that the token does not reach",
        404: "No such composite",
        409: "Not as things are",
        422: "A parameter or a body that is not valid",
    }
)

CompositeId = Annotated[str, Path(pattern=ID), Plain]


def routes(
    facts: TwinFacts,
    composite_service: CompositeService,
    known: Callable[..., Awaitable[Registration]],
    queue: ComputeQueue,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    facts
        About the twins within composites.
    known
        Gives the registration of the twin in the path, or raises.
    queue
        Where it is waited for what takes long.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["composites"])
    listing, changing, reading = BoundedThreads(2), BoundedThreads(1), BoundedThreads(4)
    Known = Annotated[Registration, Depends(known)]

    async def seen(request: Request, composite_id: str) -> Mapping[str, Composite]:
        """Composites that the caller may see; refused where the one asked for is none."""
        composites = await reading.run(
            lambda: composite_service.all(principal_of(request.scope))
        )
        if composite_id in composites:
            return composites
        if await reading.run(lambda: composite_service.exists(composite_id)):
            raise out_of_reach(composite_id)
        raise ProblemError(
            404,
            "no-such-composite",
            f"No composite is called {composite_id}. Registered: "
            f"{', '.join(list(composites)[:20]) or 'none yet'}. Register it with PUT "
            f"/api/v1/composites/{composite_id}.",
        )

    @api.get("/composites", response_model=models.CompositeList)
    async def list_composites(request: Request) -> Response:
        """List composites with their members and health; ask for one to get all else."""

        def listed() -> bytes:
            composites = composite_service.all(principal_of(request.scope))
            visible = {name: twins_of(name, composites) for name in composites}
            within = itertools.chain.from_iterable(visible.values())
            healths = facts.health(list(dict.fromkeys(within)))
            briefs = [
                {
                    "id": name,
                    "name": composites[name].name or name,
                    "kind": composites[name].kind,
                    "members": composites[name].members,
                    "health": health(healths, twins),
                }
                for name, twins in visible.items()
            ]
            return to_json({"composites": briefs})

        return Response(await listing.run(listed), media_type=JSON)

    async def assessed(
        request: Request, composite_id: str, horizon: float | None, status: int = 200
    ) -> Response:
        composites = dict(await seen(request, composite_id))

        def assessment() -> bytes:
            try:
                check_tree(composite_id, composites)
            except WrongCompositeError as error:
                raise ProblemError(409, "too-large-now", str(error)) from error
            return to_json(assess(facts, composites, composite_id, horizon))

        body = await queue.run(
            request,
            assessment,
            group=composite_id,
            share=(composite_id, composites[composite_id].to_json(), horizon, status),
        )
        return Response(body, status, media_type=JSON)

    @api.put(
        "/composites/{composite_id}",
        response_model=models.CompositeModel,
        responses={201: {"model": models.CompositeModel}, **_PROBLEMS},
    )
    async def register(
        request: Request, composite_id: CompositeId, wanted: Composite
    ) -> Response:
        """Register a composite, or register it anew; what it was before is kept."""
        release_body_slot(request.scope)
        who = principal_of(request.scope)
        new = await changing.run(lambda: composite_service.register(composite_id, wanted, who))
        return await assessed(request, composite_id, None, 201 if new else 200)

    @api.get(
        "/composites/{composite_id}",
        response_model=models.CompositeModel,
        responses=_PROBLEMS,
    )
    async def one_composite(
        request: Request,
        composite_id: CompositeId,
        horizon: Annotated[
            float | None,
            Query(gt=0, le=1e300, allow_inf_nan=False, description="In slow time."),
        ] = None,
    ) -> Response:
        """Health, failure probability with importance of the members, and pooled rates."""
        return await assessed(request, composite_id, horizon)

    @api.delete("/composites/{composite_id}", status_code=204, responses=_PROBLEMS)
    async def delete(request: Request, composite_id: CompositeId) -> Response:
        """Delete a composite; its members stay, and so do its former registrations."""
        await seen(request, composite_id)
        who = principal_of(request.scope)
        await changing.run(lambda: composite_service.delete(composite_id, who))
        return Response(status_code=204)

    @api.get(
        "/composites/{composite_id}/members",
        response_model=models.MemberList,
        responses=_PROBLEMS,
    )
    async def members(request: Request, composite_id: CompositeId) -> Response:
        """List what a composite is made of: its members, and the twins at any depth."""
        composites = await seen(request, composite_id)
        told = [
            {"id": name, "kind": composites[name].kind if name in composites else "twin"}
            for name in composites[composite_id].members
        ]
        twins = twins_of(composite_id, composites)
        return _json({"id": composite_id, "members": told, "twins": twins})

    @api.get(
        "/composites/{composite_id}/revisions",
        response_model=models.RevisionList,
        responses=_PROBLEMS,
    )
    async def revisions(request: Request, composite_id: CompositeId) -> Response:
        """List the registrations of a composite, in order.

        Each is told to who may see the twins that it held when it was registered.
        """
        await seen(request, composite_id)
        who = principal_of(request.scope)
        found = await reading.run(lambda: composite_service.revisions(composite_id, who))
        return _json({"id": composite_id, "revisions": found})

    @api.get(
        "/composites/{composite_id}/events",
        response_model=EventList,
        responses=_PROBLEMS,
    )
    async def events(
        composite_id: CompositeId,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=10_000)] = 100,
    ) -> Response:
        """List the newest events of a composite; with `after`, those that follow that number.

        They say that a member was registered anew or deleted, to who may see the site of the
        composite, and name members of this site only.
        """
        found = await reading.run(
            lambda: composite_service.events(
                composite_id, after=after or 0, limit=limit, newest=after is None
            )
        )
        return _json({"events": [event_object(*event) for event in found]})

    @api.get(
        "/twins/{twin_id}/memberships",
        response_model=models.MembershipList,
        responses=_PROBLEMS,
    )
    def of_twin(request: Request, twin_id: TwinId, registration: Known) -> Response:
        """List the composites that a twin is in: at once, and at any height."""
        composites = composite_service.all(principal_of(request.scope))
        told = {
            "id": twin_id,
            "composites": memberships(twin_id, composites),
            "above": above(twin_id, composites),
        }
        return _json(told)

    return api


def _json(content: Any) -> Response:
    return Response(to_json(content), media_type=JSON)
