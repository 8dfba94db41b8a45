"""ASGI application of a fleet: requests about a twin to its shard, about all twins to all.

Composites, which may have twins of several shards, are composed here of what the shards tell.
It keeps nothing of any request but the page's own files, so that several may stand before the
same shards.
"""

import asyncio
import logging
import re
from http import HTTPStatus

from fastapi import APIRouter, FastAPI, Request, Response
from pydantic_core import from_json, to_json

from twin_server.identity.principals import NOBODY, principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.api import SEE_LOG, health, larger_bodies
from twin_server.serve.composites import routes as composite_routes
from twin_server.serve.exports import graph_routes
from twin_server.serve.http import packing, problems
from twin_server.serve.http.body_limit import BodyLimit
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.http.quotas import CountedForHolder
from twin_server.serve.routes import page
from twin_server.serve.routes.session import session
from twin_server.serve.routes.twin_path import TwinId
from twin_server.serve.routes.twins import composite_of_that_id
from twin_server.serve.state_rendering import json_response
from twin_server.settings import TwinSettings

from .calls import Calls, is_down, owner, unavailable
from .composing import KEEPER, ShardAssets, ShardComposites, ShardFacts
from .forwarding import ShardAnswer, ShardSilentError, ask, forward
from .merging import MERGED, merged_metrics
from .supervisor import Shards

logger = logging.getLogger(__name__)

_OF_TWIN = re.compile(r"^/api/v1/twins/([^/]+)(?:/.*)?$")
_OF_CHAIN = re.compile(r"^/api/v1/ledger/chains/([^/]+)/")

METHODS = ["GET", "HEAD", "PUT", "POST", "DELETE", "PATCH", "OPTIONS"]

HEADS = "/api/v1/ledger/heads"
HOLDINGS = "/api/v1/holdings"
RECORDINGS = "/api/v1/recordings"


def create_front(shards: Shards, settings: TwinSettings) -> FastAPI:
    """Make the application.

    Parameters
    ----------
    shards
        Where each shard answers.
    settings
        Of the whole fleet: how long a shard may take, the secret of the shards, and the limits
        of requests.
    """
    app = FastAPI(title="slowtime twin server", openapi_url=None, docs_url=None, redoc_url=None)
    problems.install(app)
    largest = larger_bodies(settings.serve, settings.recordings.max_bytes)
    app.add_middleware(BodyLimit, max_bytes=settings.serve.max_body_bytes, larger=largest)
    app.add_middleware(CountedForHolder)
    packing.install(app)
    app.include_router(page.routes())
    app.include_router(session())
    calls = Calls(shards, settings.shards.key, settings.shards.answer_timeout_s)
    composites = ShardComposites(calls)
    front = _Front(shards, settings, composites)
    app.add_api_route("/healthz", front.healthz, methods=["GET"])
    app.add_api_route("/readyz", front.readyz, methods=["GET"])
    app.add_api_route("/metrics", front.metrics, methods=["GET"])
    for path in MERGED:
        app.add_api_route(path, front.of_all, methods=["GET"])
    app.add_api_route(f"{HOLDINGS}/{{holding_id}}", front.of_any, methods=["DELETE"])
    app.include_router(_composed(calls, composites, front, settings), prefix="/api/v1")
    app.add_api_route("/{path:path}", front.of_one, methods=METHODS)
    return app


def _composed(
    calls: Calls, composites: ShardComposites, front: "_Front", settings: TwinSettings
) -> APIRouter:
    """Make the routes whose answers are composed of those of several shards."""
    serve = settings.serve
    queue = ComputeQueue(
        serve.workers, serve.max_waiting, serve.max_waiting_of_one, serve.spare_workers
    )
    assets = ShardAssets(calls)
    api = APIRouter()
    api.include_router(composite_routes(ShardFacts(calls), composites, front.registered, queue))
    api.include_router(
        graph_routes(assets.of_sites, assets.of_twin, front.registered, composites)
    )
    return api


class _Front:
    """Handlers of the routes."""

    def __init__(
        self, shards: Shards, settings: TwinSettings, composites: ShardComposites
    ) -> None:
        self._shards, self._composites = shards, composites
        self._timeout_s, self._key = settings.shards.answer_timeout_s, settings.shards.key
        self._looking = BoundedThreads(4)

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
            notes = [
                f"Shard {index}: {note}"
                for index, answer in enumerate(answers)
                if answer is not None
                for note in from_json(answer.body).get("notes", [])
            ]
            return json_response(health(request, notes))
        if principal_of(request.scope) is NOBODY:
            down = [SEE_LOG]
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
            raise unavailable(
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

    async def of_any(self, request: Request) -> Response:
        """Pass a request to all shards; the answer of the one that has what it is about."""
        answers = [one for one in await self._ask_all(request, request.method) if one]
        if not answers:
            raise unavailable("No shard answers.")
        found = min(answers, key=lambda one: one.status)
        told = Response(found.body, found.status)
        told.raw_headers = found.headers
        return told

    async def of_one(self, request: Request) -> Response:
        """Pass a request to the shard that has its twin."""
        path: str = request.scope["path"]
        twin = _OF_TWIN.match(path)
        if twin is not None:
            await self._check_no_composite(request.method, path, twin[1])
            index = owner(twin[1], self._shards.count)
        elif (chain := _OF_CHAIN.match(path)) is not None:
            index = owner(chain[1], self._shards.count)
        elif path == HEADS:
            index = self._shard_named(request)
        elif path.startswith(RECORDINGS):
            index = 0  # which keeps what is being sent and replayed
        else:
            index = self._any()
        url = self._shards.url(index)
        if url is not None:
            try:
                answer = await forward(request, url, self._timeout_s, self._key)
            except ShardSilentError:
                pass
            else:
                if twin is not None and index != KEEPER:
                    await self._note_deletion(request.method, path, twin[1], answer)
                return answer
        about = f" It has {twin[1]:.120}." if twin is not None else ""
        raise unavailable(self._is_down(index) + about)

    async def registered(self, request: Request, twin_id: TwinId) -> Registration:
        """Return what the shard of a twin has it registered as, or its refusal."""
        index = owner(twin_id, self._shards.count)
        url = self._shards.url(index)
        if url is None:
            raise unavailable(f"{self._is_down(index)} It has {twin_id}.")
        try:
            answer = await ask(
                request, url, self._timeout_s, self._key, f"/api/v1/twins/{twin_id}".encode()
            )
        except ShardSilentError as error:
            raise unavailable(f"{self._is_down(index)} It has {twin_id}.") from error
        told = from_json(answer.body)
        if answer.status != HTTPStatus.OK:
            raise ProblemError(answer.status, told["type"].rpartition(":")[2], told["detail"])
        return Registration.from_json(to_json(told["registration"]).decode())

    async def _note_deletion(
        self, method: str, path: str, twin_id: str, answer: Response
    ) -> None:
        """Tell the keeper of composites of a twin that another shard has deleted."""
        if method != "DELETE" or path != f"/api/v1/twins/{twin_id}":
            return
        if answer.status_code != HTTPStatus.NO_CONTENT:
            return
        try:
            await self._looking.run(lambda: self._composites.note_deleted_twin(twin_id))
        except ProblemError as error:
            logger.warning("No event says that %s was deleted: %s", twin_id, error)

    async def _check_no_composite(self, method: str, path: str, twin_id: str) -> None:
        """Refuse to register a twin whose id is that of a composite."""
        if method != "PUT" or path != f"/api/v1/twins/{twin_id}":
            return
        if await self._looking.run(lambda: self._composites.exists(twin_id)):
            raise composite_of_that_id(twin_id)

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

    async def _ask_all(self, request: Request, method: str = "GET") -> list[ShardAnswer | None]:
        """Ask every shard the same; None of those that do not answer."""

        async def one(index: int) -> ShardAnswer | None:
            url = self._shards.url(index)
            if url is None:
                return None
            try:
                return await ask(request, url, self._timeout_s, self._key, method=method)
            except ShardSilentError:
                return None

        return list(await asyncio.gather(*map(one, range(self._shards.count))))

    def _is_down(self, index: int) -> str:
        return is_down(index, self._shards.count)


def _detail(answer: ShardAnswer) -> str:
    """Return what the problem document of an answer says."""
    try:
        return str(from_json(answer.body)["detail"])
    except (ValueError, KeyError, TypeError):
        return f"It answers with status {answer.status}."
