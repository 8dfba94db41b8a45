"""REST under /api/v1, health and metrics, and the page; errors are problem documents."""

import asyncio
import importlib.metadata
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any

import plotly
from fastapi import APIRouter, Depends, FastAPI, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic_core import from_json, to_json
from starlette.responses import FileResponse

from slowtime_schemas import asyncapi
from twin_server.history.details import without_shapes
from twin_server.history.rendering import event_object, points, state_objects
from twin_server.identity.principals import EVERYBODY, NOBODY, principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.models.history import EventList, HashModel, HeadList, HistoryModel
from twin_server.serve.models.twins import (
    HealthModel,
    ModesModel,
    OfElements,
    State,
    TwinList,
    TwinModel,
)
from twin_server.settings import ServeSettings

from . import composites, exports
from .composites import CompositeService
from .http import problems
from .http.body_limit import BodyLimit
from .http.body_queue import BodyQueue, release_body_slot
from .http.bounded_threads import BoundedThreads
from .http.coalescing import CoalescedCall
from .http.compute_queue import ComputeQueue
from .http.problems import ProblemError
from .instants import Moment, MomentText, moment_of
from .knowledge import HistoryPart, Knowledge
from .live import Hub, LiveResponse
from .metrics import exposition
from .openapi_document import document
from .routes import (
    alarms,
    asset_events,
    diagnoses,
    fatigue,
    forecasts,
    plans,
    recordings,
    risks,
    simulations,
)
from .routes.alarms import AlarmService
from .routes.asset_events import AssetEventService
from .routes.diagnoses import DiagnosisService
from .routes.recordings import RecordingService
from .routes.session import session
from .routes.twin_path import TwinId, registered_in

WEB = Path(__file__).parent / "web"
PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"
JSON = "application/json"

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
    }
)
MANY_POINTS = 10_000
"""Points of one history from which on it takes a thread for long, and much memory."""

READY_S = 5.0
"""How long the database may take to answer until the server is said not to be ready."""

_OF_ONE_MODE = State.model_fields.keys() - OfElements.model_fields
_EMPTY: dict[str, Any] = dict.fromkeys(_OF_ONE_MODE) | {
    "correlation": 0.0,
    "assumed": [],
    "frequency_used": "measured",
    "valid": False,
    "missing_before": 0,
}
_MODE: dict[str, Any] = {
    "identity": None,
    "model_mode": None,
    "kind": "structural",
    "shape": None,
}


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
) -> FastAPI:
    """Make the ASGI application; without `ordering`, one that diagnoses nothing.

    Parameters
    ----------
    recording_service, largest_recording
        Of recordings; without it, none are known of.
    queue
        Where it is waited for what takes long; by default one as the settings say.
    alarm_service
        Of alarms and their deliveries; without it, alarms are events only.
    events
        Of repairs and inspections; without it, none can be recorded.
    composite_service
        Of composites; without it, there are none.
    """
    if queue is None:
        queue = ComputeQueue(
            settings.workers, settings.max_waiting, settings.max_waiting_of_one
        )
    app = FastAPI(
        title="slowtime twin server",
        version=importlib.metadata.version("slowtime"),
        summary="Stiffness and mass in slow time, with uncertainty.",
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    problems.install(app)
    larger = {"/api/v1/recordings/": largest_recording} if recording_service is not None else {}
    app.add_middleware(BodyQueue, streamed="/api/v1/recordings/")
    app.add_middleware(BodyLimit, max_bytes=settings.max_body_bytes, larger=larger)
    known = registered_in(knowledge)
    changing = BoundedThreads(2)
    app.include_router(
        _twins(knowledge, hub, settings, known, changing, composite_service), prefix="/api/v1"
    )
    app.include_router(forecasts.routes(knowledge, settings, known, queue), prefix="/api/v1")
    app.include_router(plans.routes(knowledge, known, queue), prefix="/api/v1")
    app.include_router(risks.routes(knowledge, known, queue), prefix="/api/v1")
    app.include_router(simulations.routes(knowledge, known, queue), prefix="/api/v1")
    all_composites = dict if composite_service is None else composite_service.all
    app.include_router(
        exports.routes(knowledge, known, settings.max_exports, all_composites),
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
    if composite_service is not None:
        app.include_router(
            composites.routes(knowledge, composite_service, known, queue), prefix="/api/v1"
        )
    if recording_service is not None:
        app.include_router(recordings.routes(recording_service), prefix="/api/v1")
    app.include_router(_operations(knowledge, hub, settings, queue, alarm_service))
    app.include_router(session())
    app.include_router(_page())
    document(app)
    return app


def _twins(
    knowledge: Knowledge,
    hub: Hub,
    settings: ServeSettings,
    known: Callable[[str], Awaitable[Registration]],
    changing: BoundedThreads,
    composite_service: CompositeService | None,
) -> APIRouter:
    api = APIRouter(tags=["twins"])
    listing, reading = BoundedThreads(2), BoundedThreads(2)

    Known = Annotated[Registration, Depends(known)]

    def described(
        twin_id: str, registration: Registration, at: Moment | None, *, shapes: bool = True
    ) -> str:
        chapter = knowledge.latest(twin_id, at)
        found = _objects(twin_id, chapter, shapes=shapes)
        state = next(found, None) or _no_state(twin_id, at)
        more = to_json(
            {
                "alive": knowledge.alive(twin_id),
                "heard_ns": knowledge.heard_ns(twin_id),
                "sensor": knowledge.sensor(twin_id),
                "raised": knowledge.raised(twin_id),
                "nominal": knowledge.nominal(twin_id),
                "normal": knowledge.normal(twin_id),
                "registration": registration.to_dict(),
            }
        ).decode()
        return f"{state[:-1]},{more[1:]}"

    @api.get("/twins", response_model=TwinList)
    async def list_twins(request: Request) -> Response:
        """All twins, each with its latest state; shapes are left to `modes`."""

        def listed() -> bytes:
            seen = filter(principal_of(request.scope).sees, knowledge.ids())
            all_of_them = [(i, knowledge.registration(i)) for i in seen]
            texts = [
                described(i, r, None, shapes=False) for i, r in all_of_them if r is not None
            ]
            return f'{{"twins":[{",".join(texts)}]}}'.encode()

        return Response(await listing.run(listed), media_type=JSON)

    @api.put(
        "/twins/{twin_id}",
        response_model=TwinModel,
        responses={201: {"model": TwinModel}, **_PROBLEMS},
    )
    async def register(
        request: Request, twin_id: TwinId, registration: Registration
    ) -> Response:
        """Register a twin, or register it anew: its history is then estimated again."""
        release_body_slot(request.scope)
        if composite_service is not None and twin_id in composite_service.all():
            raise ProblemError(
                409,
                "is-a-composite",
                f"{twin_id} is a composite. Give the twin another id, or delete the composite.",
            )
        new = await changing.run(lambda: knowledge.register(twin_id, registration))
        told = await run_in_threadpool(described, twin_id, registration, None)
        return Response(told, 201 if new else 200, media_type=JSON)

    @api.get("/twins/{twin_id}", response_model=TwinModel, responses=_PROBLEMS)
    def one_twin(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Show a twin with its latest state, or the last one not later than `at`."""
        moment = moment_of("at", at)
        return Response(described(twin_id, registration, moment), media_type=JSON)

    @api.delete("/twins/{twin_id}", status_code=204, responses=_PROBLEMS)
    async def delete(twin_id: TwinId, registration: Known) -> Response:
        """Forget a twin and its history. While its edge publishes, a new one is begun."""
        await changing.run(lambda: knowledge.delete(twin_id))
        return Response(status_code=204)

    @api.get("/twins/{twin_id}/history", response_model=HistoryModel, responses=_PROBLEMS)
    async def history(
        twin_id: TwinId,
        registration: Known,
        start: MomentText = None,
        end: MomentText = None,
        max_points: Annotated[
            int,
            Query(ge=2, le=settings.max_points, description="Extremes are never left out."),
        ] = settings.default_points,
        shapes: Annotated[
            bool, Query(description="With the shapes of all modes, which are most of it.")
        ] = False,
    ) -> Response:
        """States from `start` to `end`, both included."""
        since, until = moment_of("start", start), moment_of("end", end)

        def told() -> bytes:
            chapter = knowledge.history(twin_id, since, until, max_points)
            objects = _objects(twin_id, chapter, shapes=shapes)
            if chapter.bands is None:
                return points(objects)
            elements = registration.changes == "elements"
            names = registration.structure().free if elements else ()
            return points(objects, chapter.bands, chapter.units[-1], names)

        is_short = max_points <= MANY_POINTS
        body = await (run_in_threadpool(told) if is_short else reading.run(told))
        return Response(body, media_type=JSON)

    @api.get("/twins/{twin_id}/modes", response_model=ModesModel, responses=_PROBLEMS)
    def modes(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Modes of the latest epoch, or of the last one not later than `at`, with shapes."""
        return _json(_modes(knowledge, twin_id, moment_of("at", at)))

    @api.get("/twins/{twin_id}/history/hash", response_model=HashModel, responses=_PROBLEMS)
    def history_hash(twin_id: TwinId, registration: Known) -> Response:
        """One number for a whole history: equal where the histories are, to the last bit."""
        digest, count = knowledge.digest(twin_id)
        return _json({"id": twin_id, "sha256": digest, "features": count})

    @api.get("/ledger/heads", response_model=HeadList, responses=_PROBLEMS)
    def heads(
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=10_000)] = 1,
    ) -> Response:
        """Give the newest signed head of the ledger; with `after`, those that follow."""
        return _json({"heads": knowledge.heads(after, limit)})

    @api.get("/twins/{twin_id}/events", response_model=EventList, responses=_PROBLEMS)
    def events(
        twin_id: TwinId,
        registration: Known,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=10_000)] = 100,
    ) -> Response:
        """List the newest events; with `after`, those that follow the one of that number."""
        found = knowledge.events(twin_id, after=after or 0, limit=limit, newest=after is None)
        return _json({"events": [event_object(*event) for event in found]})

    @api.get(
        "/twins/{twin_id}/live",
        response_class=Response,
        responses={
            200: {
                "description": "Server-sent events `state`, `event` and `reset`. Resumable.",
                "content": {"text/event-stream": {}},
            },
            **_PROBLEMS,
        },
    )
    async def live(
        twin_id: TwinId,
        registration: Known,
        request: Request,
        last_event_id: Annotated[str | None, Header()] = None,
    ) -> Response:
        """States and events as they become durable; `Last-Event-ID` brings what was missed."""
        principal = principal_of(request.scope)
        client = hub.join(twin_id, None if principal is EVERYBODY else principal.name)
        if client is None:
            raise ProblemError(
                503,
                "too-many-clients",
                f"{hub.count} clients watch already. Allowed: max_live_clients, and of one "
                "token max_live_of_one. Try again later, or ask for the history instead.",
                **{"Retry-After": "5"},
            )
        return LiveResponse(hub, client, knowledge, last_event_id, principal.still)

    return api


def _operations(
    knowledge: Knowledge,
    hub: Hub,
    settings: ServeSettings,
    queue: ComputeQueue,
    alarm_service: AlarmService | None,
) -> APIRouter:
    """Make the routes of those who watch the server: none waits for what the others ask."""
    api = APIRouter(tags=["operations"])
    troubles = CoalescedCall(knowledge.troubles, "readyz")
    counted = CoalescedCall(
        lambda: exposition(
            knowledge, hub.count, hub.dropped, settings.max_measured, queue, alarm_service
        ),
        "metrics",
    )

    @api.get("/healthz", response_model=HealthModel)
    async def healthz() -> Response:
        """Whether the process lives."""
        return _json({"status": "ok"})

    @api.get(
        "/readyz",
        response_model=HealthModel,
        responses={503: {"content": {problems.MEDIA_TYPE: {}}, "description": "Not ready"}},
    )
    async def readyz(request: Request) -> Response:
        """Whether the server can do its work: bus, worker and database."""
        try:
            found = await asyncio.wait_for(troubles.ask(), READY_S)
        except TimeoutError:
            found = [
                f"The database has not answered for {READY_S:g} s: a history is being made "
                "anew, or the disk is slow. Wait, or look at the log."
            ]
        if found:
            if principal_of(request.scope) is NOBODY:
                found = ["The server's log says why."]
            return problems.respond(request, 503, "not-ready", " ".join(found))
        return _json({"status": "ok"})

    @api.get("/api/v1/asyncapi.json", response_class=Response)
    def streams() -> Response:
        """Give the AsyncAPI document: what travels on the bus, as this one is of REST."""
        return Response(asyncapi.served(), media_type=JSON)

    @api.get("/metrics", response_class=Response)
    async def metrics() -> Response:
        """Give counts and gauges as Prometheus reads them."""
        text = await counted.ask()
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    return api


def _page() -> APIRouter:
    api = APIRouter(include_in_schema=False)
    files = {path.name: path for path in WEB.iterdir()} | {PLOTLY.name: PLOTLY}

    @api.get("/")
    def index() -> FileResponse:
        return FileResponse(files["index.html"], headers={"Cache-Control": "no-cache"})

    @api.get("/assets/{name}")
    def asset(name: str) -> FileResponse:
        if name not in files:
            raise ProblemError(
                404,
                "no-such-address",
                f"/assets/{name:.80} was asked for. Allowed: {', '.join(sorted(files))}.",
            )
        lasting = name == PLOTLY.name
        caching = "public, max-age=86400" if lasting else "no-cache"
        return FileResponse(files[name], headers={"Cache-Control": caching})

    return api


def _objects(twin_id: str, chapter: HistoryPart, *, shapes: bool = True) -> Any:
    bodies = chapter.bodies
    if not shapes:
        bodies = [body if body is None else without_shapes(body) for body in bodies]
    return state_objects(chapter.states, twin_id, chapter.boots, chapter.units, bodies)


def _modes(knowledge: Knowledge, twin_id: str, at: Moment | None) -> dict[str, Any]:
    """Put together the modes of a state; of a twin of one mode, the one it follows."""
    state = next(map(from_json, _objects(twin_id, knowledge.latest(twin_id, at))), None)
    if state is None:
        state = from_json(_no_state(twin_id, at))
    modes = state.get("modes")
    if modes is None:
        one = {"frequency_hz": state["frequency_hz"], "damping_ratio": state["damping_ratio"]}
        modes = [one] if state["frequency_hz"] else []
    kept = ("id", "t_ns", "slow_time", "slow_time_unit", "valid", "reasons")
    return {
        **{key: state[key] for key in kept},
        "channels": state.get("channels", []),
        "modes": [_MODE | mode for mode in modes],
        "nominal": knowledge.nominal_modes(twin_id),
    }


def _no_state(twin_id: str, at: Moment | None) -> str:
    when = "yet" if at is None else "at that moment"
    reasons = [f"There are no features {when}. Start the edge agent, or ask for a later one."]
    return to_json({**_EMPTY, "id": twin_id, "reasons": reasons}).decode()


def _json(content: object, status: int = 200) -> Response:
    return Response(to_json(content), status, media_type=JSON)
