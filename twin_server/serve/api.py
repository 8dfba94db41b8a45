"""REST under /api/v1, health and metrics, and the page; errors are problem documents."""

import asyncio
import importlib.metadata
from typing import Any

from fastapi import APIRouter, FastAPI, Request, Response

from slowtime_schemas import asyncapi
from slowtime_schemas.answers.twins import (
    HealthModel,
)
from twin_server.fairness import Holdings
from twin_server.identity.principals import NOBODY, principal_of
from twin_server.settings import ServeSettings

from . import composites, exports, ledger
from .composite_service import CompositeService
from .exports.files import Files
from .http import packing, problems
from .http.body_limit import BodyLimit
from .http.body_queue import BodyQueue
from .http.bounded_threads import BoundedThreads
from .http.coalescing import CoalescedCall
from .http.compute_queue import ComputeQueue
from .http.quotas import CountedForHolder
from .knowledge import Knowledge
from .live import Hub
from .metrics import exposition
from .openapi_document import document
from .routes import (
    alarms,
    asset_events,
    diagnoses,
    fatigue,
    forecasts,
    history,
    page,
    plans,
    quarantine,
    recordings,
    risks,
    shapes,
    simulations,
    twin_changes,
    twins,
)
from .routes import events as event_routes
from .routes.alarms import AlarmService
from .routes.asset_events import AssetEventService
from .routes.diagnoses import DiagnosisService
from .routes.holdings import routes as holding_routes
from .routes.quarantine import QuarantineService
from .routes.recordings import RecordingService
from .routes.session import session
from .routes.twin_changes import TwinChangeService
from .routes.twin_path import registered_in
from .state_rendering import json_response

JSON = "application/json"

LARGEST_MODEL = 4 << 20
"""Most bytes of a registration, whose model may hold matrices; as in a model file."""

READY_S = 5.0
"""How long the database may take to answer until the server is said not to be ready."""


SEE_LOG = "The server's log says why."
"""What strangers are told of what fails."""

RECORDINGS = "/api/v1/recordings/"


def larger_bodies(settings: ServeSettings, largest_recording: int | None) -> dict[str, int]:
    """Return what bodies may have more than `max_body_bytes`, by the start of their path.

    Parameters
    ----------
    largest_recording
        Of an upload [bytes]; None where there are none.
    """
    larger = {"/api/v1/twins/": max(settings.max_body_bytes, LARGEST_MODEL)}
    return larger if largest_recording is None else {**larger, RECORDINGS: largest_recording}


def create_app(
    knowledge: Knowledge,
    hub: Hub,
    settings: ServeSettings,
    diagnosis_service: DiagnosisService | None = None,
    recording_service: RecordingService | None = None,
    *,
    largest_recording: int = 0,
    queue: ComputeQueue | None = None,
    alarm_service: AlarmService | None = None,
    events: AssetEventService | None = None,
    composite_service: CompositeService | None = None,
    quarantine_service: QuarantineService | None = None,
    holdings: Holdings | None = None,
    changes: TwinChangeService | None = None,
) -> FastAPI:
    """Make the ASGI application of a twin server.

    A service that is None has no routes.

    Parameters
    ----------
    knowledge
        What is known of all twins.
    hub
        The live stream that clients join.
    diagnosis_service
        Orders diagnoses, and gives their results.
    recording_service
        Keeps and replays recordings.
    largest_recording
        Greatest size of an uploaded recording [bytes].
    queue
        Runs requests that compute; by default one as the settings say.
    alarm_service
        Lists and acknowledges alarms, and their deliveries.
    events
        Records repairs, replacements, inspections and notes.
    composite_service
        Registers composites.
    quarantine_service
        Lists, releases and drops messages that were set aside.
    holdings
        What is under way beside what the application itself counts.
    changes
        Changes registrations and recorded events, and keeps who changed what.
    """
    if queue is None:
        queue = ComputeQueue(
            settings.workers, settings.max_waiting, settings.max_waiting_of_one
        )
    holdings, exported = holdings or Holdings(), Files(settings.max_exports)
    for quota in (queue.quota, exported.quota, hub.quota):
        holdings.add(quota)
    app = FastAPI(
        title="slowtime twin server",
        version=importlib.metadata.version("slowtime"),
        summary="Stiffness and mass in slow time, with uncertainty.",
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    problems.install(app)
    app.add_middleware(BodyQueue, streamed=RECORDINGS)
    app.add_middleware(
        BodyLimit,
        max_bytes=settings.max_body_bytes,
        larger=larger_bodies(
            settings, None if recording_service is None else largest_recording
        ),
    )
    app.add_middleware(CountedForHolder)
    packing.install(app)
    known = registered_in(knowledge)
    changing = BoundedThreads(2)
    app.include_router(
        twins.routes(knowledge, known, changing, composite_service), prefix="/api/v1"
    )
    app.include_router(history.routes(knowledge, settings, known), prefix="/api/v1")
    app.include_router(shapes.routes(knowledge, known), prefix="/api/v1")
    app.include_router(event_routes.routes(knowledge, hub, known), prefix="/api/v1")
    app.include_router(ledger.routes(knowledge, known), prefix="/api/v1")
    app.include_router(forecasts.routes(knowledge, settings, known, queue), prefix="/api/v1")
    app.include_router(plans.routes(knowledge, known, queue), prefix="/api/v1")
    app.include_router(risks.routes(knowledge, known, queue), prefix="/api/v1")
    app.include_router(simulations.routes(knowledge, known, queue), prefix="/api/v1")
    app.include_router(
        exports.routes(knowledge, known, exported, composite_service),
        prefix="/api/v1",
    )
    app.include_router(fatigue.routes(knowledge, known), prefix="/api/v1")
    if diagnosis_service is not None:
        app.include_router(
            diagnoses.routes(diagnosis_service, known, changing), prefix="/api/v1"
        )
    if alarm_service is not None:
        app.include_router(alarms.routes(alarm_service, known), prefix="/api/v1")
    if events is not None:
        app.include_router(asset_events.routes(events, known), prefix="/api/v1")
    if changes is not None:
        app.include_router(twin_changes.routes(changes, known, changing), prefix="/api/v1")
    if quarantine_service is not None:
        app.include_router(quarantine.routes(quarantine_service, known), prefix="/api/v1")
    if composite_service is not None:
        app.include_router(
            composites.routes(
                composites.KnownFacts(knowledge), composite_service, known, queue
            ),
            prefix="/api/v1",
        )
    if recording_service is not None:
        app.include_router(recordings.routes(recording_service), prefix="/api/v1")
    app.include_router(holding_routes(holdings), prefix="/api/v1")
    app.include_router(_operations(knowledge, hub, settings, queue, alarm_service, holdings))
    app.include_router(session())
    app.include_router(page.routes())
    document(app)
    return app


def health(request: Request, notes: list[str]) -> dict[str, Any]:
    """Make the answer of a server that is ready; strangers are not told what fails."""
    if not notes:
        return {"status": "ok"}
    shown = [SEE_LOG] if principal_of(request.scope) is NOBODY else notes
    return {"status": "degraded", "notes": shown}


def _operations(
    knowledge: Knowledge,
    hub: Hub,
    settings: ServeSettings,
    queue: ComputeQueue,
    alarm_service: AlarmService | None,
    holdings: Holdings,
) -> APIRouter:
    """Make the health and metrics routes; they share nothing with other routes."""
    api = APIRouter(tags=["operations"])
    troubles = CoalescedCall(knowledge.troubles, "readyz")
    counted = CoalescedCall(
        lambda: exposition(
            knowledge,
            hub.count,
            hub.dropped,
            settings.max_measured,
            queue,
            alarm_service,
            holdings,
        ),
        "metrics",
    )

    @api.get(
        "/healthz",
        response_model=HealthModel,
        responses={503: {"content": {problems.MEDIA_TYPE: {}}, "description": "No progress"}},
    )
    async def healthz(request: Request) -> Response:
        """Whether the process lives, and goes on with its work."""
        if knowledge.stalled():
            detail = "The server stands still, and is about to end. Its log says where."
            return problems.respond(request, 503, "no-progress", detail)
        return json_response({"status": "ok"})

    @api.get(
        "/readyz",
        response_model=HealthModel,
        responses={503: {"content": {problems.MEDIA_TYPE: {}}, "description": "Not ready"}},
    )
    async def readyz(request: Request) -> Response:
        """Whether the server can do its work: bus, worker and database.

        200 with the status `degraded` where readings are taken and something else fails:
        nobody would gain if requests were kept from the server by a 503.
        """
        try:
            found = await asyncio.wait_for(troubles.ask(), READY_S)
        except TimeoutError:
            found = [
                f"The database has not answered for {READY_S:g} s: a history is being made "
                "anew, or the disk is slow. Wait, or look at the log."
            ]
        if found:
            if principal_of(request.scope) is NOBODY:
                found = [SEE_LOG]
            return problems.respond(request, 503, "not-ready", " ".join(found))
        return json_response(health(request, knowledge.cautions()))

    @api.get("/api/v1/asyncapi.json", response_class=Response)
    def streams() -> Response:
        """Return the AsyncAPI document: what travels on the bus, as this one is of REST."""
        return Response(asyncapi.served(), media_type=JSON)

    @api.get("/metrics", response_class=Response)
    async def metrics() -> Response:
        """Return counts and gauges as Prometheus reads them."""
        text = await counted.ask()
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    return api
