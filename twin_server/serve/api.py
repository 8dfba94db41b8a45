"""REST under /api/v1, health and metrics, and the page; errors are problem documents."""

import functools
import importlib.metadata
from pathlib import Path
from typing import Annotated, Any

import plotly
from fastapi import APIRouter, Depends, FastAPI, Header, Query, Request, Response
from pydantic import Field
from pydantic_core import from_json, to_json
from starlette.responses import FileResponse

from twin_server.details import without_shapes
from twin_server.registration import ID, Registration
from twin_server.rendering import estimate_objects, event_object, points, state_objects
from twin_server.settings import ServeSettings

from . import diagnoses, models, problems
from .access.principals import EVERYBODY, NOBODY, principal_of
from .diagnoses import Ordering
from .knowledge import Chapter, Knowledge
from .limits import BodyLimit
from .live import Hub, LiveResponse
from .metrics import exposition
from .moments import Moment, MomentError, parse_moment
from .problems import Problem, ProblemError
from .session import session

WEB = Path(__file__).parent / "web"
PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"
JSON = "application/json"

_PROBLEM: dict[int | str, dict[str, Any]] = {
    status: {
        "description": says,
        "content": {problems.MEDIA_TYPE: {"schema": Problem.model_json_schema()}},
    }
    for status, says in ((404, "No such twin"), (422, "A parameter that is not valid"))
}
_MOMENT = (
    "RFC 3339 (2026-11-20T12:00:00Z), nanoseconds since 1970-01-01 UTC, or slow time "
    "(slow:812.5)."
)

TwinId = Annotated[str, Field(pattern=ID)]
MomentText = Annotated[str | None, Query(description=_MOMENT, examples=["slow:812.5"])]
Finite = Annotated[float, Field(gt=0, le=1e300, allow_inf_nan=False)]
_OF_ONE_MODE = models.State.model_fields.keys() - models.OfElements.model_fields
_EMPTY: dict[str, Any] = dict.fromkeys(_OF_ONE_MODE) | {
    "correlation": 0.0,
    "assumed": [],
    "frequency_used": "measured",
    "valid": False,
    "missing_before": 0,
}

_OF_THE_WHOLE = ("stiffness_change", "mass_change")
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
    ordering: Ordering | None = None,
) -> FastAPI:
    """Make the ASGI application; without `ordering`, one that diagnoses nothing."""
    app = FastAPI(
        title="slowtime twin server",
        version=importlib.metadata.version("slowtime"),
        summary="Stiffness and mass in slow time, with uncertainty.",
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    problems.install(app)
    app.add_middleware(BodyLimit, max_bytes=settings.max_body_bytes)
    app.include_router(_twins(knowledge, hub, settings), prefix="/api/v1")
    if ordering is not None:
        app.include_router(
            diagnoses.routes(ordering, functools.partial(_known, knowledge)), prefix="/api/v1"
        )
    app.include_router(_operations(knowledge, hub))
    app.include_router(session())
    app.include_router(_page())
    return app


def _twins(knowledge: Knowledge, hub: Hub, settings: ServeSettings) -> APIRouter:
    api = APIRouter(tags=["twins"])

    def known(twin_id: TwinId) -> Registration:
        return _known(knowledge, twin_id)

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
                "nominal": knowledge.nominal(twin_id),
                "normal": knowledge.normal(twin_id),
                "registration": registration.to_dict(),
            }
        ).decode()
        return f"{state[:-1]},{more[1:]}"

    @api.get("/twins", response_model=models.TwinList)
    def list_twins(request: Request) -> Response:
        """All twins, each with its latest state; shapes are left to `modes`."""
        seen = filter(principal_of(request.scope).sees, knowledge.ids())
        all_of_them = [(i, knowledge.registration(i)) for i in seen]
        texts = [described(i, r, None, shapes=False) for i, r in all_of_them if r is not None]
        return Response(f'{{"twins":[{",".join(texts)}]}}', media_type=JSON)

    @api.put(
        "/twins/{twin_id}",
        response_model=models.TwinModel,
        responses={201: {"model": models.TwinModel}, **_PROBLEM},
    )
    def register(twin_id: TwinId, registration: Registration) -> Response:
        """Register a twin, or register it anew: its history is then estimated again."""
        new = knowledge.register(twin_id, registration)
        return Response(
            described(twin_id, registration, None), 201 if new else 200, media_type=JSON
        )

    @api.get("/twins/{twin_id}", response_model=models.TwinModel, responses=_PROBLEM)
    def one_twin(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Show a twin with its latest state, or the last one not later than `at`."""
        moment = _moment("at", at)
        return Response(described(twin_id, registration, moment), media_type=JSON)

    @api.delete("/twins/{twin_id}", status_code=204, responses=_PROBLEM)
    def delete(twin_id: TwinId, registration: Known) -> Response:
        """Forget a twin and its history. While its edge publishes, a new one is begun."""
        knowledge.delete(twin_id)
        return Response(status_code=204)

    @api.get("/twins/{twin_id}/history", response_model=models.HistoryModel, responses=_PROBLEM)
    def history(
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
        chapter = knowledge.history(
            twin_id, _moment("start", start), _moment("end", end), max_points
        )
        return Response(points(_objects(twin_id, chapter, shapes=shapes)), media_type=JSON)

    @api.get("/twins/{twin_id}/modes", response_model=models.ModesModel, responses=_PROBLEM)
    def modes(twin_id: TwinId, registration: Known, at: MomentText = None) -> Response:
        """Modes of the latest epoch, or of the last one not later than `at`, with shapes."""
        return _json(_modes(knowledge, twin_id, _moment("at", at)))

    @api.get(
        "/twins/{twin_id}/history/hash", response_model=models.HashModel, responses=_PROBLEM
    )
    def history_hash(twin_id: TwinId, registration: Known) -> Response:
        """One number for a whole history: equal where the histories are, to the last bit."""
        digest, count = knowledge.digest(twin_id)
        return _json({"id": twin_id, "sha256": digest, "features": count})

    @api.get(
        "/twins/{twin_id}/forecast", response_model=models.ForecastModel, responses=_PROBLEM
    )
    def forecast(
        twin_id: TwinId,
        registration: Known,
        horizon: Annotated[
            Finite | None,
            Query(description="How far ahead, in slow time; by default a quarter of the past."),
        ] = None,
        count: Annotated[
            int, Query(alias="points", ge=1, le=settings.max_forecast_points)
        ] = 40,
    ) -> Response:
        """Stiffness and mass change, or each element's, up to `horizon` after the last."""
        return _json(_forecast(knowledge, twin_id, horizon, count))

    @api.get("/twins/{twin_id}/events", response_model=models.EventList, responses=_PROBLEM)
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
            **_PROBLEM,
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


def _known(knowledge: Knowledge, twin_id: str) -> Registration:
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


def _operations(knowledge: Knowledge, hub: Hub) -> APIRouter:
    api = APIRouter(tags=["operations"])

    @api.get("/healthz", response_model=models.HealthModel)
    def healthz() -> Response:
        """Whether the process lives."""
        return _json({"status": "ok"})

    @api.get(
        "/readyz",
        response_model=models.HealthModel,
        responses={503: {"content": {problems.MEDIA_TYPE: {}}, "description": "Not ready"}},
    )
    def readyz(request: Request) -> Response:
        """Whether the server can do its work: bus, worker and database."""
        troubles = knowledge.troubles()
        if troubles:
            if principal_of(request.scope) is NOBODY:
                troubles = ["The server's log says why."]
            return problems.respond(request, 503, "not-ready", " ".join(troubles))
        return _json({"status": "ok"})

    @api.get("/metrics", response_class=Response)
    def metrics() -> Response:
        """Give counts and gauges as Prometheus reads them."""
        text = exposition(knowledge, hub.count, hub.dropped)
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


def _objects(twin_id: str, chapter: Chapter, *, shapes: bool = True) -> Any:
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


def _no_forecast(twin_id: str, reason: str) -> dict[str, Any]:
    none: dict[str, Any] = {"since": None, "until": None, "points": [], "valid": False}
    return {"id": twin_id, **none, "reasons": [reason]}


def _forecast(
    knowledge: Knowledge, twin_id: str, horizon: float | None, count: int
) -> dict[str, Any]:
    outlook = knowledge.outlook(twin_id, horizon, count)
    if outlook is None:
        return _no_forecast(
            twin_id,
            "There are too few valid readings to forecast from. Wait for more of them, or "
            "look at the reasons of the latest states.",
        )
    none = [None] * len(outlook.slow_time)
    of_each = {name: estimate_objects(band.tolist()) for name, band in outlook.bands.items()}
    elements = [name for name in of_each if name not in _OF_THE_WHOLE]
    return {
        "id": twin_id,
        "since": outlook.since,
        "until": outlook.until,
        "points": [
            {
                "slow_time": time,
                **{name: of_each.get(name, none)[row] for name in _OF_THE_WHOLE},
                "elements": {name: of_each[name][row] for name in elements},
            }
            for row, time in enumerate(outlook.slow_time.tolist())
        ],
        "valid": not outlook.reasons,
        "reasons": list(outlook.reasons),
    }


def _moment(name: str, text: str | None) -> Moment | None:
    if text is None:
        return None
    try:
        return parse_moment(text)
    except MomentError as error:
        raise ProblemError(422, "not-valid", f"At query.{name}, {error}") from error


def _json(content: object, status: int = 200) -> Response:
    return Response(to_json(content), status, media_type=JSON)
