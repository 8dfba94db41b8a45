"""Answers about fatigue damage and virtual quantities."""

from typing import Any, Literal

from pydantic import ConfigDict

from slowtime_schemas.quantities import Estimate

from .base import RestAnswer

FATIGUE_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "points": [
        {
            "name": "storey1.stress",
            "unit": "MPa",
            "source": "virtual",
            "damage": {"value": 0.012, "sd": 0.0065, "lo": 0.0049, "hi": 0.0296},
            "damage_per_year": 0.024,
            "rate_variation": 0.08,
            "counted_s": 15768000.0,
            "uncounted_s": 3600.0,
            "boots": 2,
            "time_to_failure_s": {"5 %": 5.3e8, "50 %": 1.31e9, "95 %": 3.2e9},
            "failed_probability": 1.2e-15,
            "capacity": {"median": 1.0, "variation": 0.3},
            "curve": {
                "constant": 1e12, "slope": 3.0, "knee": 0.0, "lower_slope": None,
                "cut_off": 0.0, "log10_sd": 0.2,
            },
            "reasons": ["quasi_static_part_unseen"],
            "course": [
                {
                    "t_ns": 1795233600123456789, "damage": 0.012, "lo": 0.0049, "hi": 0.0296,
                    "seconds": 15768000.0,
                }
            ],
            "ranges": [10.2, 20.3],
            "cycles": [51200.0, 804.5],
        }
    ],
}  # fmt: skip
VIRTUAL_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "windows": [
        {
            "boot": "20261121T035959Z-7f3a",
            "start_ns": 1795233600123456789,
            "t_ns": 1795233600323456789,
            "rate_hz": 10.0,
            "lowest_hz": 0.5,
            "valid": True,
            "reasons": [],
            "quantities": [
                {
                    "name": "base-f1.drift",
                    "unit": "m",
                    "values": [0.0011, -0.0008, 0.0004],
                    "sd": [0.0001, 0.0001, 0.0001],
                }
            ],
        }
    ],
}


class DamageMoment(RestAnswer):
    """Miner's sum at one time, with its 95 % interval, and seconds counted by then."""

    t_ns: int
    damage: float
    lo: float
    hi: float
    seconds: float


class FatiguePointModel(RestAnswer):
    """Fatigue of one point over all boots."""

    name: str
    unit: str
    source: Literal["channel", "virtual"]
    damage: Estimate
    damage_per_year: float
    rate_variation: float
    counted_s: float
    uncounted_s: float
    boots: int
    time_to_failure_s: dict[str, float | None]
    failed_probability: float
    capacity: dict[str, float]
    curve: dict[str, float | None]
    reasons: tuple[str, ...]
    course: tuple[DamageMoment, ...]
    ranges: tuple[float, ...]
    cycles: tuple[float, ...]


class FatigueModel(RestAnswer):
    """Fatigue of a twin; no points where its edge counts none."""

    id: str
    points: tuple[FatiguePointModel, ...]

    model_config = ConfigDict(json_schema_extra={"examples": [FATIGUE_EXAMPLE]})


class VirtualQuantityModel(RestAnswer):
    """An unmeasured quantity, estimated from a model."""

    name: str
    unit: str
    values: tuple[float, ...]
    sd: tuple[float, ...]


class VirtualWindowModel(RestAnswer):
    """Virtual quantities over one window."""

    boot: str
    start_ns: int
    t_ns: int
    rate_hz: float
    lowest_hz: float
    valid: bool
    reasons: tuple[str, ...]
    quantities: tuple[VirtualQuantityModel, ...]


class VirtualModel(RestAnswer):
    """Latest windows of a twin's virtual quantities; none where its edge makes none."""

    id: str
    windows: tuple[VirtualWindowModel, ...]

    model_config = ConfigDict(json_schema_extra={"examples": [VIRTUAL_EXAMPLE]})
