"""The shape of every answer, for the OpenAPI document; the answers themselves are rendered."""

from typing import Any, Literal

from pydantic import BaseModel, Field

from slowtime_schemas.messages import Shape
from slowtime_schemas.quantities import Estimate
from twin_server.orders import State as JobState
from twin_server.registration.twin import MODEL_EXAMPLE, Registration

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


_LOST = {"value": -0.08, "sd": 0.01, "lo": -0.0994, "hi": -0.0603}
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
    | {"storey2": _LOST},
    "posterior_to_prior": {"storey1": 0.036, "storey2": 0.033},
    "suspects": ["storey2"],
    "channels": ["a_floor1", "a_floor2", "a_floor3"],
    "modes": [MODE_EXAMPLE],
}


class SeenModeModel(BaseModel):
    """One mode of an epoch."""

    model_config = {"json_schema_extra": {"examples": [MODE_EXAMPLE]}}

    identity: int | None = Field(None, description="The edge's name of it, within a boot.")
    model_mode: int | None = Field(
        None, description="Which of the model's modes it is, 0 for the lowest."
    )
    frequency_hz: Estimate
    damping_ratio: Estimate | None
    kind: Literal["structural", "harmonic"] = "structural"
    shape: Shape | None = Field(
        None,
        description="One component per channel, in the unit that all of them have, else as "
        "displacements; null in histories unless asked for, and where a unit among several "
        "is unknown.",
    )


class OfElements(BaseModel):
    """What only a twin of many elements has."""

    elements: dict[str, Estimate] = Field(
        default={}, description="Relative change of each free stiffness and mass, by name."
    )
    posterior_to_prior: dict[str, float] = Field(
        default={}, description="Of each: 1 where the readings said nothing, 0 if sure."
    )
    suspects: list[str] = Field(
        default=[], description="What has changed: 'j2'; 'j1 or j4' where nobody can tell."
    )
    channels: list[str] = Field(default=[], description="Of the shapes' components, in order.")
    modes: list[SeenModeModel] = []


class State(OfElements):
    """What a twin knew after one features message."""

    model_config = {"json_schema_extra": {"examples": [STATE_EXAMPLE, ELEMENTS_EXAMPLE]}}

    id: str
    t_ns: int = Field(description="Sensor time [ns since 1970-01-01 UTC].")
    slow_time: float
    slow_time_unit: str
    frequency_hz: Estimate | None = Field(description="Natural frequency; 95 % interval.")
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None = Field(description="-0.1 once a tenth is gone.")
    mass_change: Estimate | None
    correlation: float = Field(description="Between the errors of stiffness and mass change.")
    assumed: list[str] = Field(description="Quantities that are assumed, not estimated.")
    frequency_used: Literal["measured", "smoothed"]
    valid: bool
    reasons: list[str] = Field(description="Why not, in sentences.")
    truth: dict[str, float] | None = Field(description="What a simulator knows.")
    boot: str
    sequence: int
    missing_before: int = Field(description="Features lost between the last one and this.")


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


class Entered(BaseModel):
    """A lasting change that covariates do not explain: how large, since when."""

    frequency_change: Estimate
    stiffness_change: Estimate | None = Field(
        None, description="Where only stiffness may change."
    )
    mass_change: Estimate | None = Field(None, description="Where only mass may change.")
    since: float
    since_interval: list[float]


class NormalModel(BaseModel):
    """What is normal for one frequency under temperature and load, as learnt in training."""

    model_config = {"json_schema_extra": {"examples": [NORMAL_EXAMPLE]}}

    model_mode: int | None = Field(description="Of a twin of elements; null for the one mode.")
    law: Literal["constant", "linear", "bilinear", "Gaussian process"]
    bend_c: float | None = Field(description="Where a bilinear law bends.")
    frequency_hz: float = Field(description="At `reference`.")
    reference: dict[str, float]
    readings: int = Field(description="How many it was learnt from.")
    unexplained: float = Field(description="Relative sd of what covariates leave.")
    time_between_false_alarms: float = Field(description="Mean, at least, in slow time.")
    entered: Entered | None = Field(description="While an alarm is raised.")


class RaisedModel(BaseModel):
    """An alarm of the registration that is raised."""

    quantity: str
    side: Literal["below", "above"]
    limit: float


class TwinModel(OfElements):
    """A twin: its latest state, or that at a moment, and what it is."""

    model_config = {
        "json_schema_extra": {
            "examples": [
                {
                    **STATE_EXAMPLE,
                    "alive": True,
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "registration": {"changes": "stiffness"},
                },
                {
                    **ELEMENTS_EXAMPLE,
                    "alive": True,
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "registration": MODEL_EXAMPLE,
                },
            ]
        }
    }

    id: str
    t_ns: int | None
    slow_time: float | None
    frequency_hz: Estimate | None
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    valid: bool
    reasons: list[str]
    alive: bool = Field(description="Whether the edge agent is there.")
    heard_ns: int | None = Field(
        None,
        description="When features last came, by this server's clock [ns since 1970-01-01 "
        "UTC]; null where not since it began.",
    )
    sensor: dict[str, int] | None = Field(
        None,
        description="Counters of the live sensor, as its edge agent told last; null for other "
        "inputs, and before it told. `sensor_silent_s` is 0 while it sends.",
    )
    raised: list[RaisedModel] = Field(default=[], description="Alarms that are raised now.")
    nominal: dict[str, float] | None = Field(description="None while it is being learnt.")
    normal: list[NormalModel] = Field(
        default=[], description="Under covariates; empty while it is being learnt."
    )
    registration: Registration


class TwinList(BaseModel):
    """All twins."""

    twins: list[TwinModel]


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


class InstantsModel(BaseModel):
    """One instant of each bucket."""

    t_ns: list[int]
    slow_time: list[float]


class RangeModel(BaseModel):
    """Of each bucket; null where there is nothing."""

    min: list[float | None]
    max: list[float | None]


class BandModel(RangeModel):
    """One quantity in each bucket: mean and extremes of its value, ends of its intervals."""

    mean: list[float | None]
    lo: list[float | None] = Field(description="Least lower end of the 95 % intervals.")
    hi: list[float | None] = Field(description="Greatest upper end of the 95 % intervals.")


class BandsModel(BaseModel):
    """What all readings show, in buckets of consecutive ones; columns, one number a bucket."""

    model_config = {"json_schema_extra": {"examples": [BANDS_EXAMPLE]}}

    readings: int = Field(description="All of the span that was asked for.")
    slow_time_unit: str
    count: list[int] = Field(description="Readings of each bucket.")
    valid: list[int] = Field(description="Of these, valid ones.")
    start: InstantsModel = Field(description="First reading of each bucket.")
    end: InstantsModel = Field(description="Last reading of each bucket.")
    quantities: dict[str, BandModel] = Field(description="Of those that are estimated.")
    elements: dict[str, BandModel] = {}
    truth: dict[str, RangeModel] = Field(default={}, description="What a simulator knows.")


class HistoryModel(BaseModel):
    """States in order; of more than `max_points`, those that carry the extremes."""

    points: list[State]
    bands: BandsModel | None = Field(
        None, description="What all readings show; left out where all of them are in `points`."
    )


class NominalMode(BaseModel):
    """One mode as the first epochs had it."""

    model_mode: int
    frequency_hz: float
    relative_sd: float
    damping_ratio: float | None


class ModesModel(BaseModel):
    """Modes of one epoch, with shapes, and those that the twin has learnt."""

    model_config = {
        "json_schema_extra": {
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
    }

    id: str
    t_ns: int | None
    slow_time: float | None
    slow_time_unit: str | None
    valid: bool
    reasons: list[str]
    channels: list[str] = Field(description="Of the shapes' components, in order.")
    modes: list[SeenModeModel]
    nominal: list[NominalMode] = Field(
        description="The model's modes as they were learnt; empty while they are not."
    )


class ForecastPoint(BaseModel):
    """What is expected at one slow time; null for what is not estimated."""

    slow_time: float
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    elements: dict[str, Estimate] = Field(
        default={}, description="Of a twin of elements, each stiffness and mass by name."
    )


CROSSING_EXAMPLE: dict[str, Any] = {
    "quantity": "stiffness_change",
    "threshold": -0.1,
    "toward": "below",
    "source": "alarm",
    "times": [
        {"share": 0.1, "slow_time": 1061.2, "ahead": 248.7},
        {"share": 0.5, "slow_time": 1240.9, "ahead": 428.4},
        {"share": 0.9, "slow_time": None, "ahead": None},
    ],
    "quantiles": [
        {"share": 0.05, "slow_time": 1010.4, "ahead": 197.9},
        {"share": 0.5, "slow_time": 1240.9, "ahead": 428.4},
        {"share": 0.95, "slow_time": None, "ahead": None},
    ],
    "median": 1240.9,
    "cdf": {"slow_time": [812.5, 1218.75, 1625.0], "probability": [0.0, 0.47, 0.83]},
    "within": 0.83,
    "beyond": 0.17,
    "already": 0.0,
    "laws": {"linear drift": 0.62, "Gaussian process": 0.24, "Wiener": 0.14},
    "horizon": 1625.0,
    "sentence": (
        "Stiffness change below -10 %: 10 %: by 1061.2, 50 %: by 1240.9, 90 %: not within the "
        "horizon of 1625. Crossed within it with probability 83 %."
    ),
}
FORECAST_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "since": 812.5,
    "until": 905.3,
    "slow_time_unit": "T0",
    "points": [
        {
            "slow_time": 862.5,
            "stiffness_change": {"value": -0.031, "sd": 0.004, "lo": -0.0388, "hi": -0.0232},
            "mass_change": None,
            "elements": {},
        }
    ],
    "crossings": [CROSSING_EXAMPLE],
    "periods": {"stiffness_change": None},
    "jumps": {"stiffness_change": []},
    "valid": True,
    "reasons": [],
    "warnings": [],
}


class CrossingTime(BaseModel):
    """By when a threshold has been crossed with a probability."""

    share: float = Field(description="The probability.")
    slow_time: float | None = Field(description="null: not within the horizon.")
    ahead: float | None = Field(description="The same, from the last reading on.")


class DistributionModel(BaseModel):
    """Distribution function, straight between its points."""

    slow_time: list[float]
    probability: list[float]


class CrossingModel(BaseModel):
    """When a threshold is first crossed: a distribution."""

    model_config = {"json_schema_extra": {"examples": [CROSSING_EXAMPLE]}}

    quantity: str
    threshold: float
    toward: Literal["below", "above"] | None = Field(
        description="Side that is asked for; null for the one where the quantity is not now."
    )
    source: Literal["request", "alarm", "registration"]
    times: list[CrossingTime]
    quantiles: list[CrossingTime] = Field(
        default=[], description="The same at 5, 10, 25, 50, 75, 90 and 95 %."
    )
    median: float | None = Field(
        default=None, description="Slow time; null where `within` is below one half."
    )
    cdf: DistributionModel = Field(
        default=DistributionModel(slow_time=[], probability=[]),
        description="Probability that it has been crossed by each slow time.",
    )
    within: float = Field(description="Probability that it is crossed within the horizon.")
    beyond: float = Field(
        default=1.0, description="Probability that it is not crossed within the horizon."
    )
    already: float = Field(description="Probability that it has been crossed by now.")
    laws: dict[str, float] = Field(
        default={},
        description="Degradation laws from which it follows, with their posterior probability.",
    )
    horizon: float = Field(description="Slow time up to which was looked.")
    sentence: str


class ForecastModel(BaseModel):
    """Where a twin is heading."""

    model_config = {"json_schema_extra": {"examples": [FORECAST_EXAMPLE]}}

    id: str
    since: float | None = Field(description="Slow time of the last reading.")
    until: float | None = Field(description="Beyond this the forecast repeats its trend.")
    slow_time_unit: str | None
    points: list[ForecastPoint]
    crossings: list[CrossingModel] = Field(
        description="Of each threshold: the one asked for, those of the alarms, and those of "
        "the registration's `forecast.thresholds`."
    )
    periods: dict[str, float | None] = Field(
        description="After how long each quantity repeats itself; null where it does not."
    )
    jumps: dict[str, list[float]] = Field(
        description="Slow times after which the past of a quantity went elsewhere."
    )
    valid: bool
    reasons: list[str]
    warnings: list[str] = Field(
        default=[], description="Of each quantity that no degradation law fits."
    )


class EventModel(BaseModel):
    """Something a person may want to know of, once."""

    number: int
    event_id: str = Field(
        description="The same after the history was estimated anew; `number` is not.",
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


class EventList(BaseModel):
    """Events in order; ask on with `after` set to the last one's number."""

    events: list[EventModel]


class HashModel(BaseModel):
    """SHA-256 over every features message and state of a history, in order."""

    id: str
    sha256: str = Field(examples=["195264a38bfd2376ce89e4fb5925eb18c37de77b76d2bba43073b098"])
    features: int


class DamageMoment(BaseModel):
    """Miner's sum at one time, with its 95 % interval, and seconds counted by then."""

    t_ns: int
    damage: float
    lo: float
    hi: float
    seconds: float


class FatiguePointModel(BaseModel):
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
    reasons: list[str]
    course: list[DamageMoment]
    ranges: list[float]
    cycles: list[float]


class FatigueModel(BaseModel):
    """Fatigue of a twin; no points where its edge counts none."""

    id: str
    points: list[FatiguePointModel]

    model_config = {"json_schema_extra": {"examples": [FATIGUE_EXAMPLE]}}


class VirtualQuantityModel(BaseModel):
    """A quantity that nobody measures."""

    name: str
    unit: str
    values: list[float]
    sd: list[float]


class VirtualWindowModel(BaseModel):
    """Virtual quantities over one window."""

    boot: str
    start_ns: int
    t_ns: int
    rate_hz: float
    lowest_hz: float
    valid: bool
    reasons: list[str]
    quantities: list[VirtualQuantityModel]


class VirtualModel(BaseModel):
    """Latest windows of a twin's virtual quantities; none where its edge makes none."""

    id: str
    windows: list[VirtualWindowModel]

    model_config = {"json_schema_extra": {"examples": [VIRTUAL_EXAMPLE]}}


class HeadModel(BaseModel):
    """A signed hash over what the server had accepted of all its twins."""

    number: int
    t_ns: int
    assets: int
    root: str
    previous: str
    public: str
    signature: str


class HeadList(BaseModel):
    """Heads in their order; none where the server has no key to sign with."""

    heads: list[HeadModel]

    model_config = {
        "json_schema_extra": {
            "examples": [
                {
                    "heads": [
                        {
                            "number": 7,
                            "t_ns": 1795233600123456789,
                            "assets": 2,
                            "root": "9f" * 32,
                            "previous": "5c" * 32,
                            "public": "phkz1zZnFSklHpcC5loUFGLlUp9TMlBk/UDa2AeoaYg=",
                            "signature": "bm" * 43 + "==",
                        }
                    ]
                }
            ]
        }
    }


_ORDER: dict[str, Any] = {"clock": "fast", "raw": {"duration_s": 60.0}, "quick": False}
DIAGNOSIS_EXAMPLE: dict[str, Any] = {
    "number": 3,
    "id": "lab.rig",
    "asked_ns": 1795233600123456789,
    "ended_ns": None,
    "state": "running",
    "stage": "refitting coulomb at element j2",
    "progress": 0.31,
    "seconds": 2.6,
    "request": _ORDER,
    "error": "",
    "report": None,
    "adopted": False,
}


class DiagnosisModel(BaseModel):
    """A diagnosis: how far it has come, or what it has found."""

    model_config = {"json_schema_extra": {"examples": [DIAGNOSIS_EXAMPLE]}}

    number: int
    id: str
    asked_ns: int
    ended_ns: int | None
    state: JobState
    stage: str = Field(description="While it runs, in words.")
    progress: float = Field(description="Share that is done.")
    seconds: float = Field(description="Since it began to run.")
    request: dict[str, Any] = Field(description="As it was ordered.")
    error: str = Field(description="Why there is nothing, where it failed.")
    report: dict[str, Any] | None = Field(
        description="Its report.json; of fast time, the diagnosis file of `slowtime diagnose`."
    )
    adopted: bool = Field(description="Whether the twin has taken it in.")


class DiagnosisList(BaseModel):
    """Diagnoses of a twin, the newest first."""

    diagnoses: list[DiagnosisModel]


GAP_EXAMPLE: dict[str, Any] = {
    "id": "lab.rig",
    "measure": "nrmse",
    "state": "watching",
    "sentence": "The model explains what arrives as well as it ever did.",
    "learnt": 12,
    "expected": 0.031,
    "limit": 0.047,
    "readings": [
        {"t_ns": 1795233600123456789, "nominal": 0.033, "in_use": 0.033, "disagrees": False}
    ],
}


class GapReading(BaseModel):
    """Error of the free run on one record that arrived."""

    t_ns: int = Field(description="Sensor time of its first sample.")
    nominal: float = Field(description="Of the model before anything was adopted.")
    in_use: float = Field(description="Of the model with what was adopted.")
    disagrees: bool = Field(description="Whether the limit is passed.")


class GapModel(BaseModel):
    """How far the twin's model is from what arrives, and how far it always was."""

    model_config = {"json_schema_extra": {"examples": [GAP_EXAMPLE]}}

    id: str
    measure: Literal["nrmse"]
    state: Literal["off", "waiting", "learning", "watching", "disagreeing"]
    sentence: str
    learnt: int = Field(description="Readings from which the expected gap was learnt.")
    expected: float | None
    limit: float | None
    readings: list[GapReading]


class HealthModel(BaseModel):
    """That the server lives."""

    status: str = Field(examples=["ok"])
