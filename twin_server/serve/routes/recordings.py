"""Routes of recordings: list, upload, download, replay and delete.

A recording may hold several sites; who asks sees those of which all sites are theirs.
"""

from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, Protocol

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import to_json
from starlette.responses import FileResponse

from slowtime_schemas.quantities import Plain
from twin_server.identity.principals import principal_of
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads

NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}\.mcap$"
Name = Annotated[
    str,
    Path(pattern=NAME, description="Of the file, such as monday.mcap."),
    Plain,
]
Reaches = Callable[[str], bool]
"""Whether who asks may see a site."""

_PROBLEMS = problems.answers(
    {
        403: "Not of your sites",
        404: "No such recording, or a server that keeps none",
        409: "Not as things are",
        413: "Larger than a recording may be",
        422: "A name or a file that is not valid",
        503: "Another is being taken in",
        507: "No room for it",
    }
)

_PLAYING: dict[str, Any] = {
    "state": "playing", "done": 1200, "total": 6000, "sentence": "1,200 of 6,000 messages.",
}  # fmt: skip
RECORDING_EXAMPLE: dict[str, Any] = {
    "name": "monday.mcap",
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


class ReplayOrder(BaseModel):
    """Speed of a replay."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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
    """Service of recordings; refusals are raised as `ProblemError`."""

    def listed(self, reaches: Reaches) -> Mapping[str, Any]:
        """Return all recordings that the caller may see."""
        ...

    def path(self, name: str, reaches: Reaches) -> FilePath:
        """Where one is that may be seen."""
        ...

    async def take(self, name: str, chunks: AsyncIterator[bytes], reaches: Reaches) -> None:
        """Accept a recording after it was found valid."""
        ...

    def delete(self, name: str, reaches: Reaches) -> None:
        """Delete one."""
        ...

    def play(self, name: str, speed: float | None, reaches: Reaches) -> None:
        """Begin to play one to the twins."""
        ...

    def stop_playing(self, name: str, reaches: Reaches) -> None:
        """End that."""
        ...


def routes(recording_service: RecordingService) -> APIRouter:
    """Make the routes."""
    api = APIRouter(tags=["recordings"])
    threads = BoundedThreads(2)  # a file of which nothing is known yet is read to its end

    def reaches(request: Request) -> Reaches:
        return principal_of(request.scope).reaches

    async def recording_response(request: Request, status: int = 200) -> Response:
        found = await threads.run(lambda: recording_service.listed(reaches(request)))
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

        One of that name that is there already is never replaced.
        """
        await recording_service.take(name, request.stream(), reaches(request))
        return await recording_response(request, 201)

    @api.get("/recordings/{name}", response_class=Response, responses=_PROBLEMS)
    async def give(name: Name, request: Request) -> FileResponse:
        """Return a recording as it is."""
        path = await threads.run(lambda: recording_service.path(name, reaches(request)))
        return FileResponse(path, media_type="application/octet-stream", filename=name)

    @api.delete("/recordings/{name}", response_model=RecordingList, responses=_PROBLEMS)
    async def delete(name: Name, request: Request) -> Response:
        """Delete a recording: for good."""
        await threads.run(lambda: recording_service.delete(name, reaches(request)))
        return await recording_response(request)

    @api.post(
        "/recordings/{name}/replay",
        status_code=202,
        response_model=RecordingList,
        responses=_PROBLEMS,
    )
    async def play(name: Name, order: ReplayOrder, request: Request) -> Response:
        """Play a recording to the twins, as the edges did; what they have already stays.

        One at a time. Where none of its twins is registered yet, they are registered as they
        were recorded.
        """
        await threads.run(lambda: recording_service.play(name, order.speed, reaches(request)))
        return await recording_response(request, 202)

    @api.delete("/recordings/{name}/replay", response_model=RecordingList, responses=_PROBLEMS)
    async def stop(name: Name, request: Request) -> Response:
        """End the replay of a recording; what was played stays."""
        await threads.run(lambda: recording_service.stop_playing(name, reaches(request)))
        return await recording_response(request)

    return api
