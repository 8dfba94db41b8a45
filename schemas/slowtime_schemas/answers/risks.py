"""Answers about the risk of a twin."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from .base import Extensible, RestAnswer

PROBABILITY_EXAMPLE: dict[str, Any] = {"value": 0.0021, "lo": 0.0004, "hi": 0.0063}
STATE_EXAMPLE: dict[str, Any] = {
    "name": "drift in a storm",
    "kind": "response",
    "accepted": 0.001,
    "now": {
        "probability": PROBABILITY_EXAMPLE,
        "beta": 2.86,
        "survival": {"value": 1.0, "lo": 1.0, "hi": 1.0},
        "hazard": 0.0002,
    },
    "within": {"value": 0.031, "lo": 0.008, "hi": 0.07},
    "until": 861.2,
    "points": [],
    "past": [],
    "sentence": "drift in a storm: as of slow time 812.5, fails with probability 3.1 % up to "
    "slow time 905.3; now 0.21 %. The accepted 0.001 is reached at 861.2.",
    "valid": True,
    "reasons": [],
}
RISK_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "since": 812.5,
    "horizon": 905.3,
    "slow_time_unit": "T0",
    "limit_states": [STATE_EXAMPLE],
    "valid": True,
    "reasons": [],
}


class ProbabilityModel(RestAnswer):
    """A probability, and the 90 % interval within which more readings could move it."""

    model_config = ConfigDict(json_schema_extra={"examples": [PROBABILITY_EXAMPLE]})

    value: float = Field(ge=0, le=1)
    lo: float
    hi: float


class RiskNow(RestAnswer):
    """A limit state at one slow time."""

    probability: ProbabilityModel = Field(
        description="Of failure at that moment, or at one load event then."
    )
    beta: float = Field(description="Reliability index of it, at most 12.")
    survival: ProbabilityModel = Field(description="Of no failure from the last reading on.")
    hazard: float = Field(ge=0, description="Failures per slow time of those that survive.")


class RiskPoint(RiskNow):
    """A limit state at a future slow time."""

    slow_time: float


class PastRisk(RestAnswer):
    """A limit state at a past reading, by that reading and its standard deviation."""

    slow_time: float
    probability: ProbabilityModel


class LimitStateRisk(RestAnswer):
    """One limit state: now, in the past and to come."""

    model_config = ConfigDict(json_schema_extra={"examples": [STATE_EXAMPLE]})

    name: str
    kind: Annotated[Literal["threshold", "resonance", "response", "own"], Extensible]
    accepted: float
    now: RiskNow | None
    within: ProbabilityModel | None = Field(description="Of failure up to the horizon.")
    until: float | None = Field(
        description="Slow time at which the accepted probability is reached; null: not by the "
        "horizon."
    )
    points: tuple[RiskPoint, ...]
    past: tuple[PastRisk, ...]
    sentence: str
    valid: bool
    reasons: tuple[str, ...]


class RiskModel(RestAnswer):
    """Failure probability of a twin by each limit state of its registration."""

    model_config = ConfigDict(json_schema_extra={"examples": [RISK_EXAMPLE]})
    TABLE: ClassVar[str] = "limit_states"

    id: str
    since: float | None = Field(description="Slow time of the last reading.")
    horizon: float | None
    slow_time_unit: str | None
    limit_states: tuple[LimitStateRisk, ...]
    valid: bool
    reasons: tuple[str, ...]
