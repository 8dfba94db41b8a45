"""Routes of messages that were set aside: list, release, drop."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Path, Request, Response
from pydantic import BaseModel, Field
from pydantic_core import to_json

from slowtime_schemas.quantities import Plain
from twin_server.identity.principals import principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin, or no such message aside",
        409: "The message fails again, and stays aside",
        422: "A parameter that is not valid",
    }
)
Number = Annotated[int, Path(ge=1, lt=2**62, description="Of the message set aside."), Plain]

_EXAMPLE: dict[str, Any] = {
    "number": 3,
    "id": "lab.beam",
    "boot": "20260101T000000-5f3a",
    "sequence": 1807,
    "set_ns": 1795233600123456789,
    "key": "slowtime/v1/features/lab/beam",
    "why": "it took more than 5.5 s of processor time",
    "in_history": True,
    "bytes": 812,
}


class AsideModel(BaseModel):
    """A message that was set aside."""

    model_config = {"json_schema_extra": {"examples": [_EXAMPLE]}}

    number: int = Field(description="Names it in requests.")
    id: str = Field(description="Twin of the message.")
    boot: str
    sequence: int
    set_ns: int = Field(description="When it was set aside [ns since 1970-01-01 UTC].")
    key: str = Field(description="Key of the bus under which it came.")
    why: str
    in_history: bool = Field(
        description="Whether it has its place in the history, without an estimate."
    )
    bytes: int


class AsideList(BaseModel):
    """Messages of a twin that were set aside, the newest first."""

    id: str
    messages: list[AsideModel]


class QuarantineService(Protocol):
    """Service of messages that were set aside; refusals are raised as `ProblemError`."""

    def listed(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the messages of a twin that are aside, the newest first."""
        ...

    def release(self, twin_id: str, number: int, principal: str) -> None:
        """Try a message again, and give it its estimate."""
        ...

    def drop(self, twin_id: str, number: int, principal: str) -> None:
        """Delete a message."""
        ...


def routes(
    quarantine_service: QuarantineService, known: Callable[[str], Awaitable[Registration]]
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    """
    api = APIRouter(tags=["operations"])
    threads = BoundedThreads(2)
    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/quarantine", response_model=AsideList, responses=_PROBLEMS)
    def list_aside(twin_id: TwinId, registration: Known) -> Response:
        """List messages whose processing exceeded its budget of work or failed."""
        body = {"id": twin_id, "messages": quarantine_service.listed(twin_id)}
        return Response(to_json(body), media_type="application/json")

    @api.post(
        "/twins/{twin_id}/quarantine/{number}/release", status_code=204, responses=_PROBLEMS
    )
    async def release(
        request: Request, twin_id: TwinId, number: Number, registration: Known
    ) -> Response:
        """Try a message again; all states of the twin are estimated anew with it."""
        who = principal_of(request.scope).name
        await threads.run(lambda: quarantine_service.release(twin_id, number, who))
        return Response(status_code=204)

    @api.delete("/twins/{twin_id}/quarantine/{number}", status_code=204, responses=_PROBLEMS)
    async def drop(
        request: Request, twin_id: TwinId, number: Number, registration: Known
    ) -> Response:
        """Delete a message; its place in the history stays without an estimate."""
        who = principal_of(request.scope).name
        await threads.run(lambda: quarantine_service.drop(twin_id, number, who))
        return Response(status_code=204)

    return api
