"""Answers about twins: their states, modes and raised alarms."""

import datetime
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from slowtime_schemas.keyed_access import KeyedAccess
from slowtime_schemas.messages import LinkProfile, Shape
from slowtime_schemas.quantities import Estimate

from .assessments import ASSESSMENT_EXAMPLE, MemberAssessment
from .base import Extensible, RestAnswer

ConclusionAnswer = Literal["act", "watch", "cannot_say", "no"]
"""Whether anything is wrong, the most urgent answer first."""

FindingKind = Literal[
    "limit_passed", "risk_too_high", "repair_due", "inspection_due", "risk_rising",
    "limit_near", "changed", "unexplained_change", "model_disagrees", "no_readings",
    "agent_offline", "sensor_silent", "readings_late", "learning", "not_valid", "set_aside",
]  # fmt: skip
"""What stands against a structure, or against knowing it; the most urgent first."""

_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_FREQUENCY = {"value": 2.987, "sd": 0.002, "lo": 2.983, "hi": 2.991}
_STIFFNESS = {"value": -0.0086, "sd": 0.0013, "lo": -0.0112, "hi": -0.006}
STATE_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "t_ns": 1795233600123456789,
    "slow_time": 812.5,
    "slow_time_unit": "T0",
    "frequency_hz": _FREQUENCY,
    "damping_ratio": {"value": 0.0213, "sd": 0.0009, "lo": 0.0195, "hi": 0.0231},
    "stiffness_change": _STIFFNESS,
    "mass_change": {"value": 0.0, "sd": 0.0, "lo": 0.0, "hi": 0.0},
    "correlation": 0.0,
    "assumed": ["mass_change"],
    "frequency_used": "measured",
    "valid": True,
    "reasons": [],
    "truth": {"stiffness_change": -0.0091},
    "boot": "20261121T035959Z-7f3a",
    "sequence": 812,
    "missing_before": 0,
}


SHAPE_EXAMPLE = {"re": [0.36, 0.6, 0.714], "im": [0.0, 0.0, 0.0], "sd": [0.01, 0.01, 0.01]}
MODE_EXAMPLE: dict[str, Any] = {
    "identity": 1,
    "model_mode": 0,
    "frequency_hz": _FREQUENCY,
    "damping_ratio": {"value": 0.0213, "sd": 0.0009, "lo": 0.0195, "hi": 0.0231},
    "kind": "structural",
    "shape": SHAPE_EXAMPLE,
}
ELEMENTS_EXAMPLE: dict[str, Any] = {
    **STATE_EXAMPLE,
    "id": "demo.frame",
    "stiffness_change": None,
    "mass_change": None,
    "assumed": [],
    "truth": {"storey2": -0.083},
    "elements": {"storey1": {"value": 0.004, "sd": 0.011, "lo": -0.017, "hi": 0.026}}
    | {"storey2": {"value": -0.08, "sd": 0.01, "lo": -0.0994, "hi": -0.0603}},
    "posterior_to_prior": {"storey1": 0.036, "storey2": 0.033},
    "suspects": ["storey2"],
    "channels": ["a_floor1", "a_floor2", "a_floor3"],
    "modes": [MODE_EXAMPLE],
    "assessment": ASSESSMENT_EXAMPLE,
}


class SeenModeModel(RestAnswer):
    """One mode of an epoch."""

    model_config = ConfigDict(json_schema_extra={"examples": [MODE_EXAMPLE]})

    identity: int | None = Field(None, description="The edge's name of it, within a boot.")
    model_mode: int | None = Field(
        None, description="Which of the model's modes it is, 0 for the lowest."
    )
    frequency_hz: Estimate
    damping_ratio: Estimate | None
    kind: Annotated[Literal["structural", "harmonic"], Extensible] = "structural"
    shape: Shape | None = Field(
        None,
        description="One component per channel, in the unit that all of them have, else as "
        "displacements; null in histories unless asked for, and where a unit among several "
        "is unknown.",
    )


class OfElements(RestAnswer):
    """Fields that only twins of many elements have."""

    elements: dict[str, Estimate] = Field(
        default={}, description="Relative change of each free stiffness and mass, by name."
    )
    posterior_to_prior: dict[str, float] = Field(
        default={}, description="Of each: 1 where the readings said nothing, 0 if sure."
    )
    suspects: tuple[str, ...] = Field(
        default=(), description="Changed elements: 'j2'; 'j1 or j4' if the data cannot decide."
    )
    channels: tuple[str, ...] = Field(
        default=(), description="Of the shapes' components, in order."
    )
    modes: tuple[SeenModeModel, ...] = ()
    assessment: MemberAssessment | None = Field(
        None,
        description="Latest comparison of the members with the reference period; null before "
        "the first, and where the registration asks for none.",
    )


class State(KeyedAccess, OfElements):
    """The state of a twin after one features message."""

    model_config = ConfigDict(json_schema_extra={"examples": [STATE_EXAMPLE, ELEMENTS_EXAMPLE]})

    id: str
    t_ns: int = Field(description="Sensor time [ns since 1970-01-01 UTC].")
    slow_time: float
    slow_time_unit: str
    frequency_hz: Estimate | None = Field(description="Natural frequency; 95 % interval.")
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None = Field(description="-0.1 once a tenth is gone.")
    mass_change: Estimate | None
    correlation: float = Field(description="Between the errors of stiffness and mass change.")
    assumed: tuple[str, ...] = Field(description="Quantities that are assumed, not estimated.")
    frequency_used: Annotated[Literal["measured", "smoothed"], Extensible]
    valid: bool
    reasons: tuple[str, ...] = Field(description="Why not, in sentences.")
    truth: dict[str, float] | None = Field(description="What a simulator knows.")
    boot: str
    sequence: int
    missing_before: int = Field(description="Features lost between the last one and this.")

    @property
    def time(self) -> datetime.datetime:
        """Sensor time to the microsecond; `t_ns` has all of it."""
        return _EPOCH + datetime.timedelta(microseconds=self.t_ns // 1000)


_SIZE = {"value": -0.0101, "sd": 0.0021, "lo": -0.0143, "hi": -0.0061}
NORMAL_EXAMPLE: dict[str, Any] = {
    "model_mode": None,
    "law": "bilinear",
    "bend_c": 0.12,
    "frequency_hz": 3.012,
    "reference": {"temperature_c": 7.2},
    "readings": 712,
    "unexplained": 0.0021,
    "time_between_false_alarms": 3650.0,
    "entered": {
        "frequency_change": _SIZE,
        "stiffness_change": {"value": -0.0201, "sd": 0.0042, "lo": -0.0284, "hi": -0.0122},
        "since": 412.0,
        "since_interval": [409.0, 415.0],
    },
}


class Entered(RestAnswer):
    """A lasting change that covariates do not explain: how large, since when."""

    frequency_change: Estimate
    stiffness_change: Estimate | None = Field(
        None, description="Where only stiffness may change."
    )
    mass_change: Estimate | None = Field(None, description="Where only mass may change.")
    since: float
    since_interval: tuple[float, ...]


class NormalModel(RestAnswer):
    """Normal behaviour of one frequency under temperature and load, as learnt in training."""

    model_config = ConfigDict(json_schema_extra={"examples": [NORMAL_EXAMPLE]})

    model_mode: int | None = Field(description="Of a twin of elements; null for the one mode.")
    law: Annotated[Literal["constant", "linear", "bilinear", "Gaussian process"], Extensible]
    bend_c: float | None = Field(description="Where a bilinear law bends.")
    frequency_hz: float = Field(description="At `reference`.")
    reference: dict[str, float]
    readings: int = Field(description="How many it was learnt from.")
    unexplained: float = Field(description="Relative sd of what covariates leave.")
    time_between_false_alarms: float = Field(description="Mean, at least, in slow time.")
    entered: Entered | None = Field(description="While an alarm is raised.")


CONCLUSION_EXAMPLE: dict[str, Any] = {
    "answer": "cannot_say",
    "findings": [
        {
            "kind": "agent_offline",
            "text": "Its sensor agent is offline, so nothing new is known.",
        }
    ],
    "next": "Start the sensor agent, or look at its network.",
}


class FindingModel(RestAnswer):
    """Something that stands against a structure, or against knowing it."""

    kind: Annotated[FindingKind, Extensible]
    text: str = Field(description="Details, in a sentence.")


class ConclusionModel(RestAnswer):
    """Whether anything is wrong: never `no` where nothing new is known."""

    model_config = ConfigDict(json_schema_extra={"examples": [CONCLUSION_EXAMPLE]})

    answer: Annotated[ConclusionAnswer, Extensible] = Field(
        description="`act` at once; `watch` what is coming; `cannot_say`, since data are "
        "missing; `no`."
    )
    findings: tuple[FindingModel, ...] = Field(description="Why, the most urgent first.")
    next: str | None = Field(description="What to do next; null where nothing is wrong.")


class RaisedModel(RestAnswer):
    """An alarm of the registration that is raised."""

    quantity: str
    side: Literal["below", "above"]
    limit: float


class LinkModel(RestAnswer):
    """Link of an edge agent, as its last health message told."""

    profile: LinkProfile
    health_within_s: float = Field(
        description="Longest time from one health message to the next [s].", examples=[900.0]
    )
    features_within_s: float = Field(
        description="Longest time that readings wait at the agent [s].", examples=[900.0]
    )
    offline_within_s: float = Field(
        description="Time after which a silent agent is offline [s].", examples=[120.0]
    )
    waiting: int = Field(0, description="Readings that wait at the agent.", examples=[7])
    held_until_ns: int | None = Field(
        None, description="When they are sent, where send hours or the budget hold them back."
    )
    month_bytes: int = Field(
        0,
        description="Estimated bytes of this calendar month (UTC), in both directions.",
        examples=[81234567],
    )
    budget_bytes: int | None = Field(
        None, description="Bytes that a month may take; null without a budget."
    )


class TwinStatus(OfElements):
    """A twin's latest state or that at an instant, and what holds of it now."""

    id: str
    t_ns: int | None
    slow_time: float | None
    frequency_hz: Estimate | None
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    valid: bool
    reasons: tuple[str, ...]
    conclusion: ConclusionModel | None = Field(
        None, description="Whether anything is wrong now; null of the state at an instant."
    )
    alive: bool = Field(description="Whether the edge agent is online.")
    heard_ns: int | None = Field(
        None,
        description="When features last came, by this server's clock [ns since 1970-01-01 "
        "UTC]; null where not since it began.",
    )
    aside: int = Field(
        0, description="Messages of it that were set aside (`/quarantine`).", examples=[0]
    )
    sensor: dict[str, int] | None = Field(
        None,
        description="Counters of the live sensor, as its edge agent told last; null for other "
        "inputs, and before it told. `sensor_silent_s` is 0 while it sends.",
    )
    link: LinkModel | None = Field(
        None,
        description="Intervals of the agent's messages, and bytes of its link this month; null "
        "of an agent that sends everything as it is made.",
    )
    raised: tuple[RaisedModel, ...] = Field(
        default=(), description="Alarms that are raised now."
    )
    nominal: dict[str, float] | None = Field(description="None while it is being learnt.")
    normal: tuple[NormalModel, ...] = Field(
        default=(), description="Under covariates; empty while it is being learnt."
    )


class RegisteredTwin(TwinStatus):
    """A twin, with its registration as JSON."""

    registration: dict[str, Any]


class NominalMode(RestAnswer):
    """One mode as the first epochs had it."""

    model_mode: int
    frequency_hz: float
    relative_sd: float
    damping_ratio: float | None


class ModesModel(RestAnswer):
    """Modes of one epoch, with shapes, and those that the twin has learnt."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "id": "demo.frame",
                    "t_ns": 1795233600123456789,
                    "slow_time": 812.5,
                    "slow_time_unit": "d",
                    "valid": True,
                    "reasons": [],
                    "channels": ["a_floor1", "a_floor2", "a_floor3"],
                    "modes": [MODE_EXAMPLE],
                    "nominal": [
                        {
                            "model_mode": 0,
                            "frequency_hz": 3.04,
                            "relative_sd": 0.0004,
                            "damping_ratio": 0.0208,
                        }
                    ],
                }
            ]
        }
    )

    id: str
    t_ns: int | None
    slow_time: float | None
    slow_time_unit: str | None
    valid: bool
    reasons: tuple[str, ...]
    channels: tuple[str, ...] = Field(description="Of the shapes' components, in order.")
    modes: tuple[SeenModeModel, ...]
    nominal: tuple[NominalMode, ...] = Field(
        description="The model's modes as they were learnt; empty while they are not."
    )


class HealthModel(RestAnswer):
    """That the server lives; `degraded` where it takes readings, and something else fails."""

    status: Literal["ok", "degraded"] = Field(examples=["ok"])
    notes: tuple[str, ...] = Field(
        (), description="What fails; only where the status is `degraded`."
    )
