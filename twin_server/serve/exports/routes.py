"""Routes that export histories and graphs as files."""

from collections.abc import Awaitable, Callable, Iterable, Iterator
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic_core import from_json, to_json

from slowtime_schemas.quantities import Name
from twin_server.history.rendering import state_objects
from twin_server.identity.principals import Principal, principal_of
from twin_server.registration.twin import Registration
from twin_server.serve.composite_service import CompositeService
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.instants import MomentText, moment_of
from twin_server.serve.knowledge import Knowledge
from twin_server.serve.routes.twin_path import TwinId

from .dtdl import Asset, graph
from .files import Files
from .json_ld import as_json_ld
from .tables import Format, NotInstalledError, columns_of, pages_of, written
from .telemetry import as_version_2

MEDIA_TYPES: dict[Format, str] = {
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
}
_PROBLEMS = problems.answers({404: "No such twin", 422: "A parameter that is not valid"})


Form = Literal["dtdl-3", "dtdl-2", "json-ld"]
AsForm = Annotated[
    Form, Query(alias="as", description="Version of the models, or JSON-LD without models.")
]
JSON_LD = "application/ld+json"


def written_as(whole: dict[str, Any], form: Form) -> dict[str, Any]:
    """Write a graph with models of DTDL version 3 in another form."""
    if form == "dtdl-3":
        return whole
    return as_version_2(whole) if form == "dtdl-2" else as_json_ld(whole)


def assets_of(knowledge: Knowledge, twin_ids: Iterable[str]) -> Iterator[Asset]:
    """Return the twins of the graph."""
    for twin_id in twin_ids:
        registration = knowledge.registration(twin_id)
        if registration is not None:
            latest = knowledge.latest(twin_id, None)
            told = state_objects(
                latest.states, twin_id, latest.boots, latest.units, latest.bodies
            )
            state = next(map(from_json, told), {"valid": False})
            alive = knowledge.alive(twin_id)
            yield Asset(twin_id, registration, state | {"alive": alive})


def routes(
    knowledge: Knowledge,
    known: Callable[[str], Awaitable[Registration]],
    under_way: Files,
    composite_service: CompositeService | None = None,
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    under_way
        Exports that are under way.
    composite_service
        Gives the composites that a caller may see; None for none.
    """
    api = APIRouter(tags=["exports"])
    Known = Annotated[Registration, Depends(known)]

    @api.get(
        "/twins/{twin_id}/history/export",
        response_class=Response,
        responses={
            200: {
                "description": "One row a state, with a heading.",
                "content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()},
            },
            **_PROBLEMS,
            **problems.answers(
                {
                    501: "A format that this server was not installed with",
                    429: "More than your site or token may have under way",
                    503: "Others are being given",
                }
            ),
        },
    )
    def history(
        twin_id: TwinId,
        registration: Known,
        form: Annotated[Format, Query(alias="format")] = "csv",
        start: MomentText = None,
        end: MomentText = None,
    ) -> Response:
        """Return all states from `start` to `end` as a table: none is left out."""
        pages = pages_of(knowledge, twin_id, moment_of("start", start), moment_of("end", end))
        try:
            table = written(pages, columns_of(registration), form, twin_id)
        except NotInstalledError as error:
            raise ProblemError(501, "not-installed", str(error)) from error
        return under_way.given(table, MEDIA_TYPES[form], _file(f"{twin_id}.{form}"))

    def told(site: str | None, principal: Principal) -> Iterator[Asset]:
        return assets_of(knowledge, of_site(knowledge.ids(principal), site))

    graphs = graph_routes(
        told, lambda one: assets_of(knowledge, [one]), known, composite_service
    )
    api.include_router(graphs)
    return api


def of_site(twin_ids: Iterable[str], site: str | None) -> list[str]:
    """Return the twins of a site, or all where none is given."""
    return [one for one in twin_ids if site is None or one.partition(".")[0] == site]


def graph_routes(
    of_sites: Callable[[str | None, Principal], Iterable[Asset]],
    of_twin: Callable[[str], Iterable[Asset]],
    known: Callable[..., Awaitable[Registration]],
    composite_service: CompositeService | None,
) -> APIRouter:
    """Make the routes of graphs, whichever processes have their twins.

    Parameters
    ----------
    of_sites
        Gives the twins of a site, or of all, of those that a caller may see.
    of_twin
        Gives one twin.
    composite_service
        Gives the composites that a caller may see; None for none.
    """
    listing = BoundedThreads(2)
    api = APIRouter(tags=["exports"])
    Known = Annotated[Registration, Depends(known)]

    def given(assets: Iterable[Asset], principal: Principal, name: str, form: Form) -> Response:
        composites = {} if composite_service is None else composite_service.all(principal)
        whole = graph(list(assets), composites)
        body = to_json(written_as(whole, form))
        if form == "json-ld":
            return Response(body, headers=_file(f"{name}.jsonld"), media_type=JSON_LD)
        return Response(body, headers=_file(f"{name}.dtdl.json"), media_type="application/json")

    @api.get("/twins/{twin_id}/dtdl", response_class=Response, responses=_PROBLEMS)
    def one(
        request: Request, twin_id: TwinId, registration: Known, form: AsForm = "dtdl-3"
    ) -> Response:
        """Return a twin, the parts of its model and their relations, with DTDL models."""
        return given(of_twin(twin_id), principal_of(request.scope), twin_id, form)

    @api.get(
        "/dtdl",
        response_class=Response,
        responses=problems.answers({422: "A site that cannot be called so"}),
    )
    async def sites(
        request: Request,
        site: Annotated[Name | None, Query(description="Of this site alone.")] = None,
        form: AsForm = "dtdl-3",
    ) -> Response:
        """Return sites, twins, composites and all relations as one graph, with DTDL models."""
        who = principal_of(request.scope)
        return await listing.run(lambda: given(of_sites(site, who), who, site or "sites", form))

    return api


def _file(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"'}
