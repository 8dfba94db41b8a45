"""Routes of diagnoses: order, list, read, cancel, adopt and undo."""

from collections.abc import Awaitable, Callable, Mapping
from typing import Annotated, Any, Protocol

from fastapi import APIRouter, Depends, Path, Request, Response
from pydantic_core import to_json

from slowtime_schemas.answers.diagnoses import DiagnosisList, DiagnosisModel, GapModel
from twin_server.identity.principals import Principal, principal_of
from twin_server.orders import FILES, DiagnosisOrder
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.http.problems import ProblemError

from .twin_path import TwinId

_TYPES = {
    "report.json": "application/json",
    "report.html": "text/html; charset=utf-8",
    "charts.json": "application/json",
    "augmented.yaml": "application/yaml; charset=utf-8",
}
_ALONE = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; frame-ancestors 'self'; sandbox allow-scripts"
)
"""A report draws itself, and does nothing else."""

_PROBLEMS = problems.answers(
    {
        404: "No such twin, or no such diagnosis",
        409: "Not as things are",
        422: "A body that is not valid",
        429: "Too many of your site or token wait already",
        503: "Too many wait already",
    }
)

Number = Annotated[
    int, Path(ge=1, lt=2**63, description="Of the diagnosis, among those of its twin.")
]


class DiagnosisService(Protocol):
    """Service of diagnoses; refusals are raised as `ProblemError`."""

    def order(
        self,
        twin_id: str,
        registration: Registration,
        order: DiagnosisOrder,
        principal: Principal,
    ) -> int:
        """Take an order of samples that the principal may see; its number."""
        ...

    def all_of(self, twin_id: str) -> list[dict[str, Any]]:
        """All diagnoses of a twin, the newest first."""
        ...

    def one(self, twin_id: str, number: int) -> dict[str, Any] | None:
        """One diagnosis; None where there is none of that number."""
        ...

    def file(self, twin_id: str, number: int, name: str) -> bytes | None:
        """Return a result file; None if it does not exist."""
        ...

    def cancel(self, twin_id: str, number: int) -> bool:
        """End one that waits or runs; False where it has ended already."""
        ...

    def adopt(self, twin_id: str, registration: Registration, number: int) -> None:
        """Adopt the result of a diagnosis into the twin."""
        ...

    def undo(self, twin_id: str, registration: Registration, number: int) -> None:
        """Undo the latest adoption."""
        ...

    def gap(self, twin_id: str) -> Mapping[str, Any]:
        """Return the free-run errors of the twin's models on current samples."""
        ...


def routes(
    diagnosis_service: DiagnosisService,
    known: Callable[[str], Awaitable[Registration]],
    changing: BoundedThreads,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    changing
        Threads for what has a history estimated anew.
    """
    api = APIRouter(route_class=DocumentRoute, tags=["diagnoses"])
    ordering = BoundedThreads(4)  # an edge that is asked for samples may take seconds to answer

    Known = Annotated[Registration, Depends(known)]

    def there(twin_id: str, number: int) -> dict[str, Any]:
        found = diagnosis_service.one(twin_id, number)
        if found is None:
            numbers = [str(one["number"]) for one in diagnosis_service.all_of(twin_id)[:20]]
            raise ProblemError(
                404,
                "no-such-diagnosis",
                f"{twin_id} has no diagnosis {number}. There are: "
                f"{', '.join(numbers) or 'none yet'}. Ask for one with POST "
                f"/api/v1/twins/{twin_id}/diagnoses.",
            )
        return found

    @api.post(
        "/twins/{twin_id}/diagnoses",
        status_code=202,
        response_model=DiagnosisModel,
        responses=_PROBLEMS,
    )
    async def order(
        request: Request, twin_id: TwinId, registration: Known, order: DiagnosisOrder
    ) -> Response:
        """Ask what the twin's model lacks: a job, whose number is told at once.

        From raw samples that the edge has now, from recordings, or, with `clock: slow`, from
        the twin's history and the covariates beside it.
        """
        who = principal_of(request.scope)

        def done() -> Response:
            number = diagnosis_service.order(twin_id, registration, order, who)
            where = f"/api/v1/twins/{twin_id}/diagnoses/{number}"
            return _json(there(twin_id, number), 202, Location=where)

        release_body_slot(request.scope)
        return await ordering.run(done)

    @api.get(
        "/twins/{twin_id}/diagnoses",
        response_model=DiagnosisList,
        responses=_PROBLEMS,
    )
    def list_diagnoses(twin_id: TwinId, registration: Known) -> Response:
        """All diagnoses of a twin, the newest first."""
        return _json({"diagnoses": diagnosis_service.all_of(twin_id)})

    @api.get(
        "/twins/{twin_id}/diagnoses/{number}",
        response_model=DiagnosisModel,
        responses=_PROBLEMS,
    )
    def one_diagnosis(twin_id: TwinId, number: Number, registration: Known) -> Response:
        """How far a diagnosis has come, or what it has found."""
        return _json(there(twin_id, number))

    @api.delete(
        "/twins/{twin_id}/diagnoses/{number}",
        status_code=202,
        response_model=DiagnosisModel,
        responses=_PROBLEMS,
    )
    def cancel(twin_id: TwinId, number: Number, registration: Known) -> Response:
        """Cancel a diagnosis that waits or runs; what it has found by then is lost."""
        found = there(twin_id, number)
        if not diagnosis_service.cancel(twin_id, number):
            raise ProblemError(
                409,
                "ended-already",
                f"Diagnosis {number} cannot be cancelled: it is {found['state']}. Allowed: "
                "those that wait or run.",
            )
        return _json(there(twin_id, number), 202)

    @api.get(
        "/twins/{twin_id}/diagnoses/{number}/{name}",
        response_class=Response,
        responses=_PROBLEMS,
    )
    def file(twin_id: TwinId, number: Number, name: str, registration: Known) -> Response:
        """Return a file of one that is done.

        `report.html`, `report.json`, `augmented.yaml`, or `charts.json`: the charts of the
        report, each with its heading and what it shows in words, as Plotly takes them.
        """
        found = there(twin_id, number)
        content = diagnosis_service.file(twin_id, number, name) if name in FILES else None
        if content is None:
            allowed = ", ".join(FILES) if found["state"] == "done" else "none yet"
            raise ProblemError(
                404,
                "no-such-file",
                f"{name:.60} of diagnosis {number}, which is {found['state']}, was asked for. "
                f"Allowed: {allowed}; a diagnosis in slow time has no augmented.yaml.",
            )
        headers = {"Content-Security-Policy": _ALONE} if name == "report.html" else {}
        return Response(content, media_type=_TYPES[name], headers=headers)

    @api.post(
        "/twins/{twin_id}/diagnoses/{number}/adopt",
        response_model=DiagnosisModel,
        responses=_PROBLEMS,
    )
    async def adopt(twin_id: TwinId, number: Number, registration: Known) -> Response:
        """Put what a diagnosis has found into the twin; an event says so."""

        def done() -> Response:
            there(twin_id, number)
            diagnosis_service.adopt(twin_id, registration, number)
            return _json(there(twin_id, number))

        return await changing.run(done)

    @api.post(
        "/twins/{twin_id}/diagnoses/{number}/undo",
        response_model=DiagnosisModel,
        responses=_PROBLEMS,
    )
    async def undo(twin_id: TwinId, number: Number, registration: Known) -> Response:
        """Take out again what was adopted last; an event says so."""

        def done() -> Response:
            there(twin_id, number)
            diagnosis_service.undo(twin_id, registration, number)
            return _json(there(twin_id, number))

        return await changing.run(done)

    @api.get("/twins/{twin_id}/gap", response_model=GapModel, responses=_PROBLEMS)
    def gap(twin_id: TwinId, registration: Known) -> Response:
        """How far the free run of the twin's model is from what arrives.

        `nominal` without, `in_use` with what was adopted; both over the scatter of the
        measurement, averaged over sensors.
        """
        return _json(diagnosis_service.gap(twin_id))

    return api


def _json(content: object, status: int = 200, **headers: str) -> Response:
    return Response(to_json(content), status, media_type="application/json", headers=headers)
