"""Answers about a twin's history: states, bands, events, hashes and signed heads."""

from typing import Any, Literal

from pydantic import ConfigDict, Field

from .base import RestAnswer
from .twins import State

BANDS_EXAMPLE: dict[str, Any] = {
    "readings": 1_000_000,
    "slow_time_unit": "T0",
    "count": [4096, 4096],
    "valid": [4096, 4090],
    "start": {"t_ns": [1795233600123456789, 1795274560123456789], "slow_time": [0.0, 4096.0]},
    "end": {"t_ns": [1795274550123456789, 1795315510123456789], "slow_time": [4095.0, 8191.0]},
    "quantities": {
        "stiffness_change": {
            "mean": [-0.0004, -0.0011],
            "min": [-0.0041, -0.0052],
            "max": [0.0032, 0.0029],
            "lo": [-0.0069, -0.0079],
            "hi": [0.0058, 0.0055],
        }
    },
    "elements": {},
    "truth": {"stiffness_change": {"min": [-0.0008, -0.0015], "max": [0.0, -0.0008]}},
}


class InstantsModel(RestAnswer):
    """One instant of each bucket."""

    t_ns: tuple[int, ...]
    slow_time: tuple[float, ...]


class RangeModel(RestAnswer):
    """Of each bucket; null where there is nothing."""

    min: tuple[float | None, ...]
    max: tuple[float | None, ...]


class BandModel(RangeModel):
    """One quantity in each bucket: mean and extremes of its value, ends of its intervals."""

    mean: tuple[float | None, ...]
    lo: tuple[float | None, ...] = Field(description="Least lower end of the 95 % intervals.")
    hi: tuple[float | None, ...] = Field(
        description="Greatest upper end of the 95 % intervals."
    )


class BandsModel(RestAnswer):
    """Statistics of all readings in buckets of consecutive ones; one column each."""

    model_config = ConfigDict(json_schema_extra={"examples": [BANDS_EXAMPLE]})

    readings: int = Field(description="All of the span that was asked for.")
    slow_time_unit: str
    count: tuple[int, ...] = Field(description="Readings of each bucket.")
    valid: tuple[int, ...] = Field(description="Of these, valid ones.")
    start: InstantsModel = Field(description="First reading of each bucket.")
    end: InstantsModel = Field(description="Last reading of each bucket.")
    quantities: dict[str, BandModel] = Field(description="Of those that are estimated.")
    elements: dict[str, BandModel] = Field({})
    truth: dict[str, RangeModel] = Field(default={}, description="What a simulator knows.")


class HistoryModel(RestAnswer):
    """States in order; of more than `max_points`, those that carry the extremes."""

    points: tuple[State, ...]
    bands: BandsModel | None = Field(
        None, description="What all readings show; left out where all of them are in `points`."
    )


class EventModel(RestAnswer):
    """An event for people."""

    number: int
    event_id: str = Field(
        description="The same after the history was estimated again; `number` is not.",
        examples=["5f0c2a4e9b7d41c6a3e8f1d2b4c6978a"],
    )
    id: str
    boot: str
    sequence: int
    t_ns: int
    slow_time: float | None
    kind: str = Field(examples=["alarm"])
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: dict[str, Any]


class EventList(RestAnswer):
    """Events in order; ask on with `after` set to the last one's number."""

    events: tuple[EventModel, ...]


class HashModel(RestAnswer):
    """SHA-256 over every features message and state of a history, in order."""

    id: str
    sha256: str = Field(examples=["195264a38bfd2376ce89e4fb5925eb18c37de77b76d2bba43073b098"])
    features: int
