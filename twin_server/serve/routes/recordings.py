"""Routes of recordings: list, upload, download, replay and delete.

A recording may hold several sites; who asks sees those of which all sites are theirs. Names
are unique within what one caller sees.
"""

from collections.abc import AsyncIterator, Mapping
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, Protocol

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, Field
from pydantic_core import to_json
from starlette.responses import FileResponse

from slowtime_schemas.quantities import Immutable, Plain
from twin_server.identity.principals import Principal, principal_of
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.document_route import DocumentRoute

NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}\.mcap$"
Name = Annotated[
    str,
    Path(pattern=NAME, description="Of the file, such as monday.mcap."),
    Plain,
]
OfSite = Annotated[
    str | None,
    Query(
        max_length=200,
        description="`site` of the recording, where several that you see have the name. Left "
        "out: that of the whole server, or the only one.",
    ),
]

_PROBLEMS = problems.answers(
    {
        403: "Not of your sites",
        404: "No such recording, or a server that keeps none",
        409: "Not as things are",
        413: "Larger than a recording may be",
        422: "A name or a file that is not valid",
        429: "More than your site or token may have under way",
        503: "Another is being taken in",
        507: "No room for it",
    }
)

_PLAYING: dict[str, Any] = {
    "state": "playing", "done": 1200, "total": 6000, "sentence": "1,200 of 6,000 messages.",
}  # fmt: skip
RECORDING_EXAMPLE: dict[str, Any] = {
    "name": "monday.mcap",
    "site": None,
    "bytes": 1_843_200,
    "changed_ns": 1795233600123456789,
    "start_ns": 1795233000000000000,
    "end_ns": 1795233600000000000,
    "twins": ["demo.tower"],
    "messages": {"features": 3000, "health": 600, "raw": 2400},
    "problem": None,
    "replay": _PLAYING,
}


class ReplayModel(BaseModel):
    """Progress or outcome of a replay."""

    state: Literal["playing", "done", "stopped", "failed"]
    done: int = Field(description="Messages.")
    total: int
    sentence: str


class RecordingModel(BaseModel):
    """A recording that the server keeps."""

    model_config = {"json_schema_extra": {"examples": [RECORDING_EXAMPLE]}}

    name: str
    site: str | None = Field(
        description="Sites that share its name space, joined by commas: of one that a token of "
        "these sites uploaded. Null for one of the whole server."
    )
    bytes: int
    changed_ns: int = Field(description="When it was last written to [ns since 1970].")
    start_ns: int | None = Field(description="When its first message arrived.")
    end_ns: int | None
    twins: list[str] = Field(description="Whose messages it holds.")
    messages: dict[str, int] = Field(description="By stream.")
    problem: str | None = Field(description="Why it cannot be read, and what to do.")
    replay: ReplayModel | None = Field(description="The last one since the server began.")


class RecordingList(BaseModel):
    """All recordings that the caller may see, the newest first."""

    kept: bool = Field(description="Whether the server keeps recordings at all.")
    max_bytes: int = Field(description="Of one that is given.")
    recordings: list[RecordingModel]


class ReplayOrder(Immutable):
    """Speed of a replay."""

    speed: Annotated[
        float | None,
        Field(
            gt=0,
            le=1e6,
            allow_inf_nan=False,
            description="1 as it was recorded; left out, as fast as the twins take it in.",
        ),
    ] = None


class RecordingService(Protocol):
    """Service of recordings; refusals are raised as `ProblemError`.

    It is asked with a principal, and tells of recordings of which this one may see all.
    """

    def listed(self, principal: Principal) -> Mapping[str, Any]:
        """Return all recordings that the caller may see."""
        ...

    def path(self, name: str, site: str | None, principal: Principal) -> FilePath:
        """Where one is that may be seen."""
        ...

    async def take(self, name: str, chunks: AsyncIterator[bytes], principal: Principal) -> None:
        """Accept a recording after it was found valid."""
        ...

    def delete(self, name: str, site: str | None, principal: Principal) -> None:
        """Delete one."""
        ...

    def play(
        self, name: str, site: str | None, speed: float | None, principal: Principal
    ) -> None:
        """Begin to play one to the twins."""
        ...

    def stop_playing(self, name: str, site: str | None, principal: Principal) -> None:
        """End that."""
        ...


def routes(recording_service: RecordingService) -> APIRouter:
    """Make the routes."""
    api = APIRouter(route_class=DocumentRoute, tags=["recordings"])
    threads = BoundedThreads(2)  # a file of which nothing is known yet is read to its end

    async def recording_response(request: Request, status: int = 200) -> Response:
        found = await threads.run(lambda: recording_service.listed(principal_of(request.scope)))
        return Response(to_json(found), status, media_type="application/json")

    @api.get("/recordings", response_model=RecordingList, responses=_PROBLEMS)
    async def list_recordings(request: Request) -> Response:
        """List the recordings that the server keeps, of the sites that you may see."""
        return await recording_response(request)

    @api.put(
        "/recordings/{name}",
        status_code=201,
        response_model=RecordingList,
        responses=_PROBLEMS,
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {
                    "application/octet-stream": {
                        "schema": {"type": "string", "format": "binary"}
                    }
                },
            }
        },
    )
    async def take(name: Name, request: Request) -> Response:
        """Keep a recording (MCAP): it is read to its end first, and refused if it is not sound.

        One of that name that you see already is never replaced. What a token of some sites
        uploads has a name among the recordings of the sites that it holds messages of.
        """
        await recording_service.take(name, request.stream(), principal_of(request.scope))
        return await recording_response(request, 201)

    @api.get("/recordings/{name}", response_class=Response, responses=_PROBLEMS)
    async def give(name: Name, request: Request, site: OfSite = None) -> FileResponse:
        """Return a recording as it is."""
        who = principal_of(request.scope)
        path = await threads.run(lambda: recording_service.path(name, site, who))
        return FileResponse(path, media_type="application/octet-stream", filename=name)

    @api.delete("/recordings/{name}", response_model=RecordingList, responses=_PROBLEMS)
    async def delete(name: Name, request: Request, site: OfSite = None) -> Response:
        """Delete a recording: for good."""
        who = principal_of(request.scope)
        await threads.run(lambda: recording_service.delete(name, site, who))
        return await recording_response(request)

    @api.post(
        "/recordings/{name}/replay",
        status_code=202,
        response_model=RecordingList,
        responses=_PROBLEMS,
    )
    async def play(
        name: Name, order: ReplayOrder, request: Request, site: OfSite = None
    ) -> Response:
        """Play a recording to the twins, as the edges did; what they have already stays.

        To the twins of a site one at a time. Where none of its twins is registered yet, they
        are registered as they were recorded.
        """
        who = principal_of(request.scope)
        await threads.run(lambda: recording_service.play(name, site, order.speed, who))
        return await recording_response(request, 202)

    @api.delete("/recordings/{name}/replay", response_model=RecordingList, responses=_PROBLEMS)
    async def stop(name: Name, request: Request, site: OfSite = None) -> Response:
        """End the replay of a recording; what was played stays."""
        who = principal_of(request.scope)
        await threads.run(lambda: recording_service.stop_playing(name, site, who))
        return await recording_response(request)

    return api
