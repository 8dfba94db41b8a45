"""Routes of composites: register, list, assess, and list their members."""

import itertools
from collections.abc import Awaitable, Callable, Mapping
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic_core import to_json

from slowtime_schemas.quantities import Plain
from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import above, memberships, twins_of
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import ID, Registration
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.routes.twin_path import TwinId

from . import models
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


class CompositeService(Protocol):
    """Service of composites; refusals are raised as `ProblemError`."""

    def all(self) -> Mapping[str, Composite]:
        """All composites, in the order of their registration."""
        ...

    def register(self, composite_id: str, wanted: Composite, principal: str) -> bool:
        """Register a composite; True where it is new."""
        ...

    def delete(self, composite_id: str, principal: str) -> None:
        """Delete a composite that is no member of another."""
        ...

    def revisions(self, composite_id: str) -> list[dict[str, Any]]:
        """All registrations of a composite, in order."""
        ...


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
    api = APIRouter(tags=["composites"])
    listing, changing, reading = BoundedThreads(2), BoundedThreads(1), BoundedThreads(4)
    Known = Annotated[Registration, Depends(known)]

    async def seen(request: Request, composite_id: str) -> Mapping[str, Composite]:
        """All composites, where the caller may see every twin within one."""
        composites = await reading.run(composite_service.all)
        if composite_id not in composites:
            there = [name for name in composites if _sees(request, name, composites)]
            raise ProblemError(
                404,
                "no-such-composite",
                f"No composite is called {composite_id}. Registered: "
                f"{', '.join(there[:20]) or 'none yet'}. Register it with PUT "
                f"/api/v1/composites/{composite_id}.",
            )
        _reach(request, composite_id, composites)
        return composites

    @api.get("/composites", response_model=models.CompositeList)
    async def list_composites(request: Request) -> Response:
        """List composites with their members and health; ask for one to get all else."""

        def listed() -> bytes:
            composites = composite_service.all()
            visible = {
                name: twins_of(name, composites)
                for name in composites
                if _sees(request, name, composites)
            }
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
        body = await queue.run(
            request,
            lambda: to_json(assess(facts, composites, composite_id, horizon)),
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
        before = await reading.run(composite_service.all)
        after = {**before, composite_id: wanted}
        _reach(request, composite_id, after)
        who = principal_of(request.scope).name
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
        who = principal_of(request.scope).name
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
        """List all registrations of a composite, in order."""
        await seen(request, composite_id)
        found = await reading.run(lambda: composite_service.revisions(composite_id))
        return _json({"id": composite_id, "revisions": found})

    @api.get(
        "/twins/{twin_id}/memberships",
        response_model=models.MembershipList,
        responses=_PROBLEMS,
    )
    def of_twin(request: Request, twin_id: TwinId, registration: Known) -> Response:
        """List the composites that a twin is in: at once, and at any height."""
        composites = composite_service.all()
        seen = {name for name in composites if _sees(request, name, composites)}
        told = {
            "id": twin_id,
            "composites": [name for name in memberships(twin_id, composites) if name in seen],
            "above": [name for name in above(twin_id, composites) if name in seen],
        }
        return _json(told)

    return api


def _sees(request: Request, composite_id: str, composites: Mapping[str, Composite]) -> bool:
    """Whether the caller may see a composite and every twin within it."""
    principal = principal_of(request.scope)
    return all(map(principal.sees, [composite_id, *twins_of(composite_id, composites)]))


def _reach(request: Request, composite_id: str, composites: Mapping[str, Composite]) -> None:
    """Refuse callers who may not see every twin within a composite."""
    principal = principal_of(request.scope)
    hidden = [name for name in twins_of(composite_id, composites) if not principal.sees(name)]
    if hidden:
        raise ProblemError(
            403,
            "site-out-of-reach",
            f"{composite_id} has {len(hidden)} twins of sites that the token does not reach. "
            "Ask an admin for a token that reaches the sites of all members.",
        )


def _json(content: Any) -> Response:
    return Response(to_json(content), media_type=JSON)
