"""ASGI application of a fleet: requests about a twin to its shard, about all twins to all.

It keeps nothing of any request but the page's own files, so that several may stand before the
same shards.
"""

import asyncio
import re
from http import HTTPStatus

from fastapi import FastAPI, Request, Response
from pydantic_core import from_json

from slowtime_schemas.partitions import partition_of
from slowtime_services.shards import owners
from twin_server.identity.principals import NOBODY, principal_of
from twin_server.serve.http import problems
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.routes import page
from twin_server.serve.routes.session import session
from twin_server.serve.state_rendering import json_response
from twin_server.settings import ShardSettings

from .forwarding import Answer, ShardSilentError, ask, forward
from .merging import MERGED, merged_metrics
from .supervisor import Shards

_OF_TWIN = re.compile(r"^/api/v1/twins/([^/]+)(?:/.*)?$")
_NOT_DIVIDED = re.compile(r"^/api/v1/(?:dtdl|composites/[^/]+(?:/.*)?)$")
"""Routes that need several twins at once in one process."""

RETRY_S = 2
"""When a client may ask again after a shard was down [s]; a shard starts in some seconds."""

METHODS = ["GET", "HEAD", "PUT", "POST", "DELETE", "PATCH", "OPTIONS"]

HEADS = "/api/v1/ledger/heads"
RECORDINGS = "/api/v1/recordings"


def create_front(shards: Shards, settings: ShardSettings) -> FastAPI:
    """Make the application.

    Parameters
    ----------
    shards
        Where each shard answers.
    settings
        How long a shard may take.
    """
    app = FastAPI(title="slowtime twin server", openapi_url=None, docs_url=None, redoc_url=None)
    problems.install(app)
    app.include_router(page.routes())
    app.include_router(session())
    front = _Front(shards, settings.answer_timeout_s)
    app.add_api_route("/healthz", front.healthz, methods=["GET"])
    app.add_api_route("/readyz", front.readyz, methods=["GET"])
    app.add_api_route("/metrics", front.metrics, methods=["GET"])
    for path in MERGED:
        app.add_api_route(path, front.of_all, methods=["GET"])
    app.add_api_route("/{path:path}", front.of_one, methods=METHODS)
    return app


class _Front:
    """Handlers of the routes."""

    def __init__(self, shards: Shards, timeout_s: float) -> None:
        self._shards, self._timeout_s = shards, timeout_s

    async def healthz(self) -> Response:
        """Whether the process lives."""
        return json_response({"status": "ok"})

    async def readyz(self, request: Request) -> Response:
        """Whether every shard can do its work."""
        answers = await self._ask_all(request)
        down = [
            self._is_down(index) if answer is None else f"Shard {index}: {_detail(answer)}"
            for index, answer in enumerate(answers)
            if answer is None or answer.status != HTTPStatus.OK
        ]
        if not down:
            return json_response({"status": "ok"})
        if principal_of(request.scope) is NOBODY:
            down = ["The server's log says why."]
        return problems.respond(request, 503, "not-ready", " ".join(down))

    async def metrics(self, request: Request) -> Response:
        """Metrics of all shards that answer, and which do."""
        answers = await self._ask_all(request)
        texts = {
            index: answer.body.decode()
            for index, answer in enumerate(answers)
            if answer is not None and answer.status == HTTPStatus.OK
        }
        media = "text/plain; version=0.0.4; charset=utf-8"
        return Response(merged_metrics(texts, self._shards.count), media_type=media)

    async def of_all(self, request: Request) -> Response:
        """One answer of all shards; none where a shard is down, since its twins would lack."""
        answers = await self._ask_all(request)
        silent = [index for index, answer in enumerate(answers) if answer is None]
        if silent:
            raise _unavailable(
                " ".join(map(self._is_down, silent)) + " Twins of the other shards are "
                "answered one by one."
            )
        found = [answer for answer in answers if answer is not None]
        for answer in found:
            if answer.status != HTTPStatus.OK:
                told = Response(answer.body, answer.status)
                told.raw_headers = answer.headers
                return told
        body = MERGED[request.url.path]([answer.body for answer in found])
        return Response(body, media_type="application/json")

    async def of_one(self, request: Request) -> Response:
        """Pass a request to the shard that has its twin."""
        path: str = request.scope["path"]
        if _NOT_DIVIDED.match(path):
            raise ProblemError(
                501,
                "not-with-shards",
                f"{request.method} {path:.200} was given. Composites, and the graph of all "
                "sites, need all twins in one process. Run a server without --shards for them, "
                "or ask for each twin.",
            )
        twin = _OF_TWIN.match(path)
        if twin is not None:
            index = owners(self._shards.count)[partition_of(twin[1].partition(".")[2])]
        elif path == HEADS:
            index = self._shard_named(request)
        elif path.startswith(RECORDINGS):
            index = 0  # which keeps what is being sent and replayed
        else:
            index = self._any()
        url = self._shards.url(index)
        if url is not None:
            try:
                return await forward(request, url, self._timeout_s)
            except ShardSilentError:
                pass
        about = f" It has {twin[1]:.120}." if twin is not None else ""
        raise _unavailable(self._is_down(index) + about)

    def _any(self) -> int:
        up = (i for i in range(self._shards.count) if self._shards.url(i) is not None)
        return next(up, 0)

    def _shard_named(self, request: Request) -> int:
        """Shard that the request names, since each signs heads of its own."""
        given = request.query_params.get("shard", "")
        if given.isascii() and given.isdigit() and int(given[:4]) < self._shards.count:
            return int(given)
        raise ProblemError(
            422,
            "not-valid",
            f"shard={given[:40]!r} was given. Each shard signs heads of its own. Allowed: 0 to "
            f"{self._shards.count - 1}. Give one, as ?shard=0.",
        )

    async def _ask_all(self, request: Request) -> list[Answer | None]:
        """Ask every shard the same; None of those that do not answer."""

        async def one(index: int) -> Answer | None:
            url = self._shards.url(index)
            if url is None:
                return None
            try:
                return await ask(request, url, self._timeout_s)
            except ShardSilentError:
                return None

        return list(await asyncio.gather(*map(one, range(self._shards.count))))

    def _is_down(self, index: int) -> str:
        return (
            f"Shard {index} of {self._shards.count} does not answer: it is being started, or "
            "it has failed, and the log says why."
        )


def _unavailable(detail: str) -> ProblemError:
    return ProblemError(
        503,
        "shard-down",
        f"{detail} Try again in {RETRY_S} s; edges keep what it misses.",
        **{"Retry-After": str(RETRY_S)},
    )


def _detail(answer: Answer) -> str:
    """Return what the problem document of an answer says."""
    try:
        return str(from_json(answer.body)["detail"])
    except (ValueError, KeyError, TypeError):
        return f"It answers with status {answer.status}."
