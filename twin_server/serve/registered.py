"""The twin in a path: what it may be called, and how it is registered, or that it is not."""

from collections.abc import Callable
from typing import Annotated

from fastapi import Path

from twin_server.registration import ID, Registration

from .knowledge import Knowledge
from .problems import ProblemError

TwinId = Annotated[str, Path(pattern=ID)]


def registered_in(knowledge: Knowledge) -> Callable[[str], Registration]:
    """Make what routes depend on: it gives the registration of the twin in the path."""

    def registered(twin_id: TwinId) -> Registration:
        registration = knowledge.registration(twin_id)
        if registration is None:
            site = twin_id.partition(".")[0]
            there = [i for i in knowledge.ids() if i.startswith(f"{site}.")]
            some = ", ".join(there[:20]) or "none yet"
            raise ProblemError(
                404,
                "no-such-twin",
                f"No twin is called {twin_id}. Registered: {some}. Register it with PUT "
                f"/api/v1/twins/{twin_id}.",
            )
        return registration

    return registered
