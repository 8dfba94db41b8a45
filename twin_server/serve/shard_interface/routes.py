"""Routes by which a front asks one shard for what it composes with the answers of others."""

import hashlib
from collections.abc import Collection, Mapping
from typing import Any, Protocol

from fastapi import FastAPI, Request, Response
from pydantic_core import to_json

from twin_server.composites.composite import Composite
from twin_server.identity.principals import SERVER, Principal
from twin_server.serve.composite_service import CompositeService
from twin_server.serve.composites import FailureQuestion, KnownFacts
from twin_server.serve.exports import assets_of, of_site
from twin_server.serve.http import problems
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.knowledge import Knowledge

from .messages import (
    AssetsAsked,
    CompositeOrder,
    DeletedTwin,
    Deletion,
    EventsAsked,
    FailuresAsked,
    RevisionsAsked,
    TwinsAsked,
)


class FleetComposites(CompositeService, Protocol):
    """Composites of a fleet, whose twins may be those of other processes."""

    def register(
        self,
        composite_id: str,
        wanted: Composite,
        principal: Principal,
        twins: Collection[str] | None = None,
    ) -> bool:
        """Register a composite, given which of its members are twins; True where it is new."""
        ...


def create_shard_interface(
    knowledge: Knowledge, composites: FleetComposites, queue: ComputeQueue
) -> FastAPI:
    """Make the application.

    Parameters
    ----------
    knowledge
        What is known of the twins of this shard.
    composites
        Of the whole fleet, where this is the shard that keeps them.
    """
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    problems.install(app)
    facts = KnownFacts(knowledge)
    listed = _Listed()

    @app.post("/shard/health")
    def health(asked: TwinsAsked) -> Response:
        return _json(facts.health(asked.twins))

    @app.post("/shard/failures")
    async def failures(request: Request, asked: FailuresAsked) -> Response:
        questions = {
            twin_id: FailureQuestion(one.horizon, one.failing)
            for twin_id, one in asked.asked.items()
        }
        body = await queue.run(
            request,
            lambda: to_json(facts.failures(questions)),
            group=("failures", *questions),
            share=("failures", asked.model_dump_json()),
        )
        return Response(body, media_type="application/json")

    @app.post("/shard/rates")
    def rates(asked: TwinsAsked) -> Response:
        return _json(facts.rates(asked.twins))

    @app.post("/shard/registered")
    def registered(asked: TwinsAsked) -> Response:
        return _json([one for one in asked.twins if knowledge.registration(one) is not None])

    @app.post("/shard/assets")
    def assets(asked: AssetsAsked) -> Response:
        ids = [asked.twin] if asked.twin else of_site(knowledge.ids(SERVER), asked.site)
        return _json(
            [
                [one.id, one.registration.to_json(), one.state]
                for one in assets_of(knowledge, ids)
            ]
        )

    @app.get("/shard/composites")
    def all_composites(known: str = "") -> Response:
        return Response(
            listed.since(composites.all(SERVER), known), media_type="application/json"
        )

    @app.post("/shard/composites")
    def register(order: CompositeOrder) -> Response:
        wanted = Composite.from_json(order.registration)
        principal = Principal.of_message(order.principal)
        return _json(composites.register(order.id, wanted, principal, order.twins))

    @app.post("/shard/composites/delete")
    def delete(order: Deletion) -> Response:
        composites.delete(order.id, Principal.of_message(order.principal))
        return _json(None)

    @app.post("/shard/composites/revisions")
    def revisions(asked: RevisionsAsked) -> Response:
        principal = Principal.of_message(asked.principal)
        return _json(composites.revisions(asked.id, principal))

    @app.post("/shard/composites/events")
    def events(asked: EventsAsked) -> Response:
        found = composites.events(
            asked.id, after=asked.after, limit=asked.limit, newest=asked.newest
        )
        return _json(found)

    @app.post("/shard/composites/deleted_twin")
    def deleted_twin(told: DeletedTwin) -> Response:
        composites.note_deleted_twin(told.id)
        return _json(None)

    return app


class _Listed:
    """All composites as text, made once for each change of them."""

    def __init__(self) -> None:
        self._latest: tuple[Mapping[str, Composite], str, bytes] | None = None

    def since(self, composites: Mapping[str, Composite], known: str) -> bytes:
        """Return the version of all composites; with them where `known` is another one."""
        if self._latest is None or self._latest[0] is not composites:
            texts = {name: one.to_json() for name, one in composites.items()}
            version = hashlib.sha256(to_json(texts)).hexdigest()
            whole = to_json({"version": version, "composites": texts})
            self._latest = composites, version, whole
        _, version, whole = self._latest
        return to_json({"version": version}) if known == version else whole


def _json(content: Any) -> Response:
    return Response(to_json(content), media_type="application/json")
