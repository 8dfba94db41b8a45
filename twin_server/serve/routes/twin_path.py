"""The twin id in a path, checked, and the registration it names."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Path, Query, Request
from fastapi.concurrency import run_in_threadpool

from slowtime_schemas.quantities import Finite, Plain
from twin_server.identity.principals import principal_of, site_of
from twin_server.registration.twin import ID, Registration
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.knowledge import Knowledge

TwinId = Annotated[str, Path(pattern=ID), Plain]

OfForecast = Annotated[
    Finite | None,
    Query(
        description="Slow time of the reading whose forecast (`since`) this has to agree with; "
        "of the last reading where that forecast is not kept any more. The answer says which."
    ),
]


def registered_in(knowledge: Knowledge) -> Callable[..., Awaitable[Registration]]:
    """Make the dependency that gives the registration of the twin in the path."""

    async def registered(request: Request, twin_id: TwinId) -> Registration:
        # In the event loop: a twin that is there costs a look into a dictionary.
        registration = knowledge.registration(twin_id)
        if registration is None:
            ids = await run_in_threadpool(knowledge.ids, principal_of(request.scope))
            there = [one for one in ids if site_of(one) == site_of(twin_id)]
            some = ", ".join(there[:20]) or "none yet"
            raise ProblemError(
                404,
                "no-such-twin",
                f"No twin is called {twin_id}. Registered: {some}. Register it with PUT "
                f"/api/v1/twins/{twin_id}.",
            )
        return registration

    return registered
