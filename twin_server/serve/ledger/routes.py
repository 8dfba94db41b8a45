"""Routes of signed heads and of proofs (RFC 9162, section 5)."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response

from slowtime_schemas.answers.ledger import (
    ConsistencyProof,
    HeadList,
    InclusionProof,
    TreeHeadModel,
)
from slowtime_schemas.quantities import Plain
from twin_server.registration.twin import ID, Registration
from twin_server.serve.http import problems
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.knowledge import Knowledge
from twin_server.serve.routes.twin_path import TwinId
from twin_server.serve.state_rendering import json_response

ChainId = Annotated[str, Path(pattern=ID, description="Id of the twin."), Plain]
"""A deleted twin keeps its chain, so this need not be that of a twin that is there."""

AT_ONCE = 2
"""Proofs that are made at once; sites take turns."""

_PROBLEMS = problems.answers({422: "Not valid"})
_OF_TWIN = problems.answers(
    {
        404: "No such twin or reading, or nothing of it is signed",
        409: "The server signs nothing any more",
        422: "Not valid",
    }
)


def routes(knowledge: Knowledge, known: Callable[..., Awaitable[Registration]]) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Dependency that gives the registration of the twin in the path.
    """
    api = APIRouter(tags=["ledger"])
    Known = Annotated[Registration, Depends(known)]
    proving, proofs = BoundedThreads(AT_ONCE), knowledge.proofs

    @api.get("/ledger/heads", response_model=HeadList, responses=_PROBLEMS)
    def heads(
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=10_000)] = 1,
    ) -> Response:
        """Return the newest signed head of the ledger; with `after`, those that follow."""
        found = knowledge.heads(after, limit)
        return json_response({"heads": found, "refusal": knowledge.ledger_refusal()})

    @api.get("/twins/{twin_id}/ledger", response_model=TreeHeadModel, responses=_OF_TWIN)
    def tree_head(twin_id: TwinId, registration: Known) -> Response:
        """Return the signed tree head of a twin's chain, to be kept elsewhere."""
        return json_response(proofs.head(twin_id))

    @api.get(
        "/ledger/chains/{chain}/consistency",
        response_model=ConsistencyProof,
        responses=_OF_TWIN,
    )
    async def consistency(
        chain: ChainId,
        first: Annotated[int, Query(ge=0, lt=2**63, description="Entries of a kept head")],
    ) -> Response:
        """Prove that the chain begins with the entries that a kept tree head covers."""
        return json_response(await proving.run(lambda: proofs.consistency(chain, first)))

    @api.get(
        "/ledger/chains/{chain}/inclusion", response_model=InclusionProof, responses=_OF_TWIN
    )
    async def inclusion(
        chain: ChainId,
        boot: Annotated[str, Query(min_length=1, max_length=200)],
        sequence: Annotated[int, Query(ge=0, lt=2**40)],
        before: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
    ) -> Response:
        """Prove that a reading is among the entries of the chain."""
        return json_response(
            await proving.run(lambda: proofs.inclusion(chain, boot, sequence, before))
        )

    return api
