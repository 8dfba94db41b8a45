"""Answers about mode shapes in space."""

from typing import Any

from pydantic import ConfigDict, Field

from slowtime_schemas.quantities import Estimate

from .base import RestAnswer

Vector = tuple[float, float, float]

SHAPES_EXAMPLE: dict[str, Any] = {
    "id": "demo.mast",
    "t_ns": 1795233600123456789,
    "slow_time": 812.5,
    "slow_time_unit": "d",
    "nodes": [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]],
    "names": ["foot", "top"],
    "lines": [[0, 1]],
    "groups": ["legs"],
    "group_of_line": [0],
    "changes": {"legs": {"value": -0.012, "sd": 0.011, "lo": -0.034, "hi": 0.01}},
    "changed": [],
    "sensors": [{"channel": "a1", "node": 1, "along": [1.0, 0.0, 0.0], "measured": True}],
    "modes": [
        {
            "model_mode": 0, "model_hz": 2.98, "measured_hz": 2.987, "measured_sd_hz": 0.002,
            "mac": 0.998,
            "wire": {"re": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "im": None},
            "points": {"nodes": [1], "re": [[0.99, 0.0, 0.0]], "im": [[0.01, 0.0, 0.0]]},
        }
    ],
}  # fmt: skip


class SensorMarkModel(RestAnswer):
    """Where a channel is, and along which line it measures."""

    channel: str
    node: int = Field(description="Number of the node, counted from 0.")
    along: Vector
    measured: bool = Field(description="Whether the epoch has readings of this channel.")


class MotionModel(RestAnswer):
    """Displacements: real parts, and imaginary ones where there are any."""

    re: tuple[Vector, ...]
    im: tuple[Vector, ...] | None


class PointsModel(MotionModel):
    """Displacements of the nodes that have sensors."""

    nodes: tuple[int, ...]


class SpatialModeModel(RestAnswer):
    """A mode of the model, a measured one, or both."""

    model_mode: int | None = Field(description="Counted from 0; null where only measured.")
    model_hz: float | None
    measured_hz: float | None
    measured_sd_hz: float | None
    mac: float | None = Field(description="Of the measured shape and the model's at sensors.")
    wire: MotionModel | None = Field(
        description="Of each node; the node that moves farthest moves by 1."
    )
    points: PointsModel | None = Field(
        description="Measured displacement of the nodes with sensors, at the model's scale; "
        "across the lines of the sensors, as in the model."
    )


class ShapesModel(RestAnswer):
    """Wireframe of a model, with mode shapes."""

    model_config = ConfigDict(json_schema_extra={"examples": [SHAPES_EXAMPLE]})

    id: str
    t_ns: int | None
    slow_time: float | None
    slow_time_unit: str | None
    nodes: tuple[Vector, ...] = Field(description="Positions [m].")
    names: tuple[str, ...]
    lines: tuple[tuple[int, int], ...]
    groups: tuple[str, ...] = Field(description="Parameters that scale parts of the model.")
    group_of_line: tuple[int | None, ...]
    changes: dict[str, Estimate] = Field(
        description="Relative change of the stiffness of each group that the twin estimates."
    )
    changed: tuple[str, ...] = Field(description="Groups that are suspected to have changed.")
    sensors: tuple[SensorMarkModel, ...]
    modes: tuple[SpatialModeModel, ...] = Field(description="In ascending frequency.")
