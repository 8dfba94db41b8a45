"""Routes of simulations of a twin under a load."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, Field

from slowtime_schemas.quantities import Estimate
from twin_server.orders import SimulationOrder
from twin_server.registration.twin import Registration
from twin_server.serve.http import problems
from twin_server.serve.http.body_queue import release_body_slot
from twin_server.serve.http.compute_queue import ComputeQueue
from twin_server.serve.http.document_route import DocumentRoute
from twin_server.serve.knowledge import Knowledge

from .twin_path import TwinId

_PROBLEMS = problems.answers(
    {
        404: "No such twin",
        409: "Not enough is known of the twin yet",
        422: "A body that is not valid, or too much at once",
        429: "More than your site or token may have under way",
        503: "Others are being run",
    }
)


SIMULATIONS = "simulations"
"""Group of all simulations: each may take memory and a processor for seconds."""

_PEAK = {"value": 0.021, "sd": 0.0007, "lo": 0.0197, "hi": 0.0224}
EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "slow_time": 812.5,
    "slow_time_unit": "T0",
    "on": "base",
    "load_unit": "m/s^2",
    "quantity": "displacement",
    "unit": "m",
    "frame": "relative_to_base",
    "rate_hz": 100.0,
    "draws": 400,
    "level": 0.95,
    "seed": 0,
    "t_s": [0.0, 0.01],
    "load": [0.5, 0.476],
    "outputs": {
        "mass": {
            "value": [0.0, -2.4e-05],
            "sd": [0.0, 1e-08],
            "lo": [0.0, -2.402e-05],
            "hi": [0.0, -2.398e-05],
            "peak": _PEAK,
            "rms": {"value": 0.0112, "sd": 0.0005, "lo": 0.0103, "hi": 0.0122},
        }
    },
    "today": {
        "changes": {"stiffness_change": {"value": -0.0086, "sd": 0.0009}},
        "frequencies_hz": [{"value": 4.978, "sd": 0.0023, "lo": 4.974, "hi": 4.983}],
        "damping_ratios": [{"value": 0.0102, "sd": 0.0004, "lo": 0.0094, "hi": 0.011}],
    },
    "assumed": ["mass_change is none", "the structure is linear"],
    "valid": True,
    "reasons": [],
}


class ResponseModel(BaseModel):
    """Motion of one node at the instants `t_s`, with a summary."""

    value: list[float] = Field(description="Mean over the draws.")
    sd: list[float]
    lo: list[float]
    hi: list[float]
    peak: Estimate = Field(description="Of the largest magnitude.")
    rms: Estimate


class BelievedModel(BaseModel):
    """A change, and its standard deviation."""

    value: float
    sd: float


class TodayModel(BaseModel):
    """The estimated current structure, from which the bands follow."""

    changes: dict[str, BelievedModel]
    frequencies_hz: list[Estimate]
    damping_ratios: list[Estimate]


class SimulationModel(BaseModel):
    """Response of a twin, from rest, under a load, with bands from the uncertain structure."""

    model_config = {"json_schema_extra": {"examples": [EXAMPLE]}}

    id: str
    slow_time: float = Field(description="Of the twin that was run: its last state's.")
    slow_time_unit: str
    on: str
    load_unit: str
    quantity: Literal["displacement", "velocity", "acceleration"]
    unit: str
    frame: Literal["absolute", "relative_to_base"]
    rate_hz: float
    draws: int
    level: float
    seed: int = Field(description="The same seed gives the same answer.")
    t_s: list[float]
    load: list[float]
    outputs: dict[str, ResponseModel] = Field(description="By node.")
    today: TodayModel
    assumed: list[str] = Field(description="What was taken for granted, in words.")
    valid: bool
    reasons: list[str] = Field(description="Why the bands should not be relied on.")


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
    api = APIRouter(route_class=DocumentRoute, tags=["twins"])

    @api.post("/twins/{twin_id}/simulate", response_model=SimulationModel, responses=_PROBLEMS)
    async def simulate(
        request: Request,
        twin_id: TwinId,
        registration: Annotated[Registration, Depends(known)],
        order: SimulationOrder,
    ) -> Response:
        """Run today's twin under a load, and give its response with bands.

        Stiffness, mass and damping are drawn from what is believed of them now; each structure
        drawn is run from rest under the same load, which is straight between its samples.
        """
        await run_in_threadpool(knowledge.check, twin_id, order)
        release_body_slot(request.scope)
        answer = await queue.run(
            request,
            lambda: knowledge.simulate(twin_id, order),
            group=SIMULATIONS,
            share=(SIMULATIONS, twin_id, order),
        )
        return Response(answer, media_type="application/json")

    return api
