"""Routes of the maintenance plan of a twin, and of the inspection plan of a fleet."""

import math
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic_core import to_json

from slowtime.decisions.fleet import VisitCandidate, dispatch
from slowtime_schemas.answers import plans as plan_models
from twin_server.identity.principals import principal_of
from twin_server.registration.costs import RepairTerms, months_of
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.knowledge import Knowledge

from .twin_path import OfForecast, TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        422: "A parameter that is not valid",
        429: "More than your site or token may have under way",
        503: "Too many wait already; `Retry-After` says when to come back",
    }
)
_OF_ALL = problems.answers(
    {
        422: "A parameter that is not valid",
        429: "More than your site or token may have under way",
        503: "Too many wait already; `Retry-After` says when to come back",
    }
)
DAY_S = 86400.0
Days = Annotated[float, Query(gt=0, le=36525, description="Days within which teams inspect.")]
Teams = Annotated[int, Query(ge=1, le=1000, description="Teams.")]
Visits = Annotated[int, Query(ge=1, le=1000, description="Inspections each team can make.")]
Budget = Annotated[
    float | None, Query(ge=0, le=1e15, description="What the inspections may cost in all.")
]

Lead = Annotated[
    float | None,
    Query(
        ge=0,
        le=1e12,
        description="From the order of a repair to its effect, in `costs.time_unit`.",
    ),
]
Months = Annotated[
    str | None,
    Query(
        max_length=40,
        description="Months in which a repair can take effect, such as 5-9 or 4,5,9-11.",
    ),
]
Accepted = Annotated[
    float | None,
    Query(
        gt=0,
        lt=1,
        description="Accepted probability of a failure before a repair takes effect.",
    ),
]


def routes(
    knowledge: Knowledge, known: Callable[[str], Awaitable[Registration]], queue: ComputeQueue
) -> APIRouter:
    """Make the routes.

    Parameters
    ----------
    known
        Gives the registration of the twin in the path, or raises.
    queue
        Where it is waited for what takes long.
    """
    api = APIRouter(tags=["twins"])

    Known = Annotated[Registration, Depends(known)]

    @api.get("/twins/{twin_id}/plan", response_model=plan_models.PlanModel, responses=_PROBLEMS)
    async def plan(
        request: Request,
        twin_id: TwinId,
        registration: Known,
        since: OfForecast = None,
        lead_time: Lead = None,
        months: Months = None,
        accepted: Accepted = None,
    ) -> Response:
        """Tell what to do, by when and why: options side by side with their expected costs.

        Of the registration's `costs` and `decision`, and of the forecast after the last
        reading; `docs/maintenance_plan.md` describes how. Lead time, months and accepted
        probability take the place of those registered, in this answer only.
        """
        terms = RepairTerms(lead_time, months, accepted)
        try:
            months_of(months or "1-12")
        except ValueError as error:
            raise problems.ProblemError(
                422, "not-valid", f"At query.months: {error}"
            ) from error
        body = await queue.run(
            request,
            lambda: to_json(knowledge.plan(twin_id, since=since, terms=terms)),
            group=("plan", twin_id),
            share=("plan", twin_id, registration, since, terms),
            light=True,
        )
        return Response(body, media_type="application/json")

    @api.get("/fleet/plan", response_model=plan_models.FleetPlanModel, responses=_OF_ALL)
    async def fleet_plan(
        request: Request,
        teams: Teams = 1,
        visits: Visits = 1,
        window_d: Days = 30.0,
        budget: Budget = None,
    ) -> Response:
        """Where the inspection teams go within a window, by the net value of an inspection.

        Of all twins with `costs` and `decision` whose costs are in one currency, that of most
        of them. Their plans may be 25 readings old.
        """
        ids = knowledge.ids(principal_of(request.scope))

        def plan_document() -> bytes:
            return to_json(fleet_answer(knowledge, ids, teams * visits, window_d, budget))

        share = ("fleet", tuple(ids), teams, visits, window_d, budget)
        body = await queue.run(request, plan_document, group="fleet plan", share=share)
        return Response(body, media_type="application/json")

    return api


def fleet_answer(
    knowledge: Knowledge,
    ids: Iterable[str],
    visits: int,
    window_d: float,
    budget: float | None,
) -> dict[str, Any]:
    """Rank the twins of a fleet as REST does."""
    plans, without = [], []
    for twin_id in ids:
        plan = knowledge.plan(twin_id, stale=True)
        if plan["valid"]:
            plans.append(plan)
        else:
            without.append({"id": twin_id, "reason": plan["sentence"]})
    currencies = [plan["currency"] for plan in plans]
    currency = max(currencies, key=currencies.count, default=None)
    for plan in plans:
        if plan["currency"] != currency:
            reason = f"Its costs are in {plan['currency']}, those of most twins in {currency}."
            without.append({"id": plan["id"], "reason": reason})
    assets = [_asset(plan, window_d) for plan in plans if plan["currency"] == currency]
    return _ranked(assets, without, currency, visits, window_d, budget)


def merged_fleet_answers(answers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Rank the twins of several answers together, as if they were of one server.

    The currency is that of most twins; those of another one are not ranked.
    """
    visits, window_d, budget = (answers[0][name] for name in ("visits", "window_d", "budget"))
    currencies = [each["currency"] for each in answers for _ in each["assets"]]
    currency = max(currencies, key=currencies.count, default=None)
    assets: list[dict[str, Any]] = []
    without: list[dict[str, str]] = []
    for answer in answers:
        without += answer["without"]
        if answer["currency"] == currency:
            assets += answer["assets"]
        else:
            reason = (
                f"Its costs are in {answer['currency']}, those of most twins in {currency}."
            )
            without += [{"id": asset["id"], "reason": reason} for asset in answer["assets"]]
    without.sort(key=lambda one: one["id"])
    return _ranked(assets, without, currency, visits, window_d, budget)


def _ranked(
    assets: list[dict[str, Any]],
    without: list[dict[str, str]],
    currency: str | None,
    visits: int,
    window_d: float,
    budget: float | None,
) -> dict[str, Any]:
    """Choose which of the assets are visited, and put the most urgent first."""
    chosen = dispatch(
        [
            VisitCandidate(asset["id"], asset["net"], asset["cost"])
            for asset in assets
            if asset["net"] is not None
        ],
        visits,
        budget,
    )
    sent = {one.asset for one in chosen}
    for asset in assets:
        asset["visit"] = asset["id"] in sent
    assets.sort(key=_urgency)
    return {
        "window_d": window_d,
        "visits": visits,
        "budget": budget,
        "currency": currency,
        "sentence": _sentence(assets, currency, window_d),
        "assets": assets,
        "without": without,
    }


def _asset(plan: dict[str, Any], window_d: float) -> dict[str, Any]:
    within = [one for one in plan["inspections"] if _days(plan, one) <= window_d]
    best = max(within, key=lambda one: float(one["net"]), default=None)
    return {
        "id": plan["id"],
        "action": plan["action"],
        "sentence": plan["sentence"],
        "inspection": best and best["name"],
        "at": best and best["at"],
        "net": best and best["net"],
        "cost": best and best["cost"],
        "visit": False,
    }


def _days(plan: dict[str, Any], one: dict[str, Any]) -> float:
    """Days until an inspection; without a calendar only an immediate one is near."""
    ahead = float(one["at"]["ahead"])
    if ahead == 0.0:
        return 0.0
    return ahead * plan["seconds"] / DAY_S if plan["seconds"] is not None else math.inf


def _urgency(asset: dict[str, Any]) -> tuple[bool, bool, float]:
    net = -math.inf if asset["net"] is None else asset["net"]
    return not asset["visit"], asset["action"] != "repair", -net


def _sentence(assets: list[dict[str, Any]], currency: str | None, window_d: float) -> str:
    if not assets:
        return "No twin has costs, a decision and enough readings: nothing can be ranked."
    repairs = [asset["id"] for asset in assets if asset["action"] == "repair"]
    urgent = f" Repair now: {', '.join(repairs)}." if repairs else ""
    visits = [asset for asset in assets if asset["visit"]]
    if not visits:
        return f"No inspection within {window_d:g} days is worth its cost.{urgent}"
    each = ", ".join(
        f"{asset['id']} ({asset['inspection']}, worth {asset['net']:,.3g} {currency} net)"
        for asset in visits
    )
    return f"Inspect within {window_d:g} days: {each}.{urgent}"
