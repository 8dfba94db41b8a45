"""Renders the states and modes of a twin as JSON objects."""

from typing import Any

from fastapi import Response
from pydantic_core import from_json, to_json

from slowtime_schemas.answers.twins import (
    OfElements,
    State,
)
from twin_server.history.details import without_shapes
from twin_server.history.rendering import state_objects
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.instants import Moment
from twin_server.serve.knowledge import HistoryPart, Knowledge

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


def state_texts(twin_id: str, part: HistoryPart, *, shapes: bool = True) -> Any:
    """Render the states of a part of a history as JSON objects."""
    bodies = part.bodies
    if not shapes:
        bodies = [body if body is None else without_shapes(body) for body in bodies]
    return state_objects(part.states, twin_id, part.boots, part.units, bodies)


def modes_of(knowledge: Knowledge, twin_id: str, at: Moment | None) -> dict[str, Any]:
    """Render the modes of a state; of a twin of one mode, the one it follows."""
    state = next(map(from_json, state_texts(twin_id, knowledge.latest(twin_id, at))), None)
    if state is None:
        state = from_json(no_state(twin_id, at))
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


def shapes_of(knowledge: Knowledge, twin_id: str, at: Moment | None) -> dict[str, Any]:
    """Render the shapes of a state in space.

    Raises
    ------
    ProblemError
        Where the twin's model has no geometry.
    """
    state = next(map(from_json, state_texts(twin_id, knowledge.latest(twin_id, at))), None)
    if state is None:
        state = from_json(no_state(twin_id, at))
    scene = knowledge.spatial_scene(twin_id, state)
    if scene is None:
        raise ProblemError(
            404,
            "no-geometry",
            f"The model of {twin_id} has no geometry. Register a `frame`, or a model that "
            "`slowtime model reduce --out` wrote of matrices whose `dofs` have positions.",
        )
    return {
        **{key: state[key] for key in ("id", "t_ns", "slow_time", "slow_time_unit")},
        **scene,
    }


def no_state(twin_id: str, at: Moment | None) -> str:
    """Render the state of a twin that has none at an instant."""
    when = "yet" if at is None else "at that moment"
    reasons = [f"There are no features {when}. Start the edge agent, or ask for a later one."]
    return to_json({**_EMPTY, "id": twin_id, "reasons": reasons}).decode()


def json_response(content: object, status: int = 200) -> Response:
    """Answer with content as JSON."""
    return Response(to_json(content), status, media_type="application/json")
