"""Routes of what is under way for the sites of a caller: list it, and end it."""

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, Field
from pydantic_core import to_json

from twin_server.fairness import HeldKind, Holdings
from twin_server.identity.principals import principal_of
from twin_server.serve.http import problems
from twin_server.serve.http.problems import ProblemError

_PROBLEMS = problems.answers(
    {
        404: "Nothing of that id is under way",
        409: "It ends by itself and cannot be cancelled",
    }
)

HoldingId = Annotated[
    str, Path(pattern=r"^[0-9a-f]{16}$", description="Of what is under way, as it is listed.")
]


class HoldingModel(BaseModel):
    """Something that is under way, and counts for a site and a token."""

    id: str = Field(examples=["9f86d081884c7d65"])
    kind: HeldKind = Field(
        description="uploads, replays, diagnoses, computations (forecasts, simulations, plans, "
        "risks), exports or streams.",
        examples=["uploads"],
    )
    what: str = Field(examples=["upload of monday.mcap"])
    site: str = Field(
        description="Site that it counts for; several are joined by commas, * are all.",
        examples=["lab"],
    )
    token: str = Field(description="Name of the token.", examples=["ann (1a2b3c4d)"])
    since_ns: int = Field(description="When it began [ns since 1970].")
    cancellable: bool


class QuotaModel(BaseModel):
    """How much of one kind may be under way."""

    kind: str = Field(examples=["uploads"])
    most: int = Field(description="Of all sites together; one site may hold half.")
    held: int = Field(description="By the sites that you may see.")


class HoldingList(BaseModel):
    """What is under way for the sites of the caller, the oldest first, and what is allowed."""

    holdings: list[HoldingModel]
    quotas: list[QuotaModel]


def routes(holdings: Holdings) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    holdings
        All that is under way.
    """
    api = APIRouter(tags=["operations"])

    def listed(request: Request) -> Response:
        seen = holdings.seen(principal_of(request.scope))
        kinds = [one["kind"] for one in seen]
        quotas = [
            {"kind": quota.kind, "most": quota.most, "held": kinds.count(quota.kind)}
            for quota in holdings.quotas()
        ]
        body = to_json({"holdings": seen, "quotas": quotas})
        return Response(body, media_type="application/json")

    # In the event loop: what is cancelled may be a task of it.
    @api.get("/holdings", response_model=HoldingList)
    async def list_holdings(request: Request) -> Response:
        """List uploads, replays, diagnoses, computations, exports and streams of your sites."""
        return listed(request)

    @api.delete("/holdings/{holding_id}", response_model=HoldingList, responses=_PROBLEMS)
    async def cancel(holding_id: HoldingId, request: Request) -> Response:
        """End what holds your site up, whoever of it has begun it."""
        found = holdings.find(holding_id, principal_of(request.scope))
        if found is None:
            raise ProblemError(
                404,
                "no-such-holding",
                f"Nothing with the id {holding_id} is under way for your sites. GET "
                "/api/v1/holdings lists what is.",
            )
        if found.on_cancel is None:
            raise ProblemError(
                409,
                "not-cancellable",
                f"{found.what} is being prepared. Try again in a second.",
            )
        found.on_cancel()
        return listed(request)

    return api
