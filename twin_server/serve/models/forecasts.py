"""Answers about the forecast of a twin."""

from typing import Any, Literal

from pydantic import BaseModel, Field

from slowtime_schemas.quantities import Estimate

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
        "horizon of 1625. Crossed by 1625 with probability 83 %, as of 812.5."
    ),
}
FORECAST_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "since": 812.5,
    "horizon": 1625.0,
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


class ForecastPoint(BaseModel):
    """Forecast at one slow time; null for quantities that are not estimated."""

    slow_time: float
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    elements: dict[str, Estimate] = Field(
        default={}, description="Of a twin of elements, each stiffness and mass by name."
    )


class CrossingTime(BaseModel):
    """By when a threshold has been crossed with a probability."""

    share: float = Field(description="The probability.")
    slow_time: float | None = Field(description="null: not within the horizon.")
    ahead: float | None = Field(description="The same, from the last reading on.")


class DistributionModel(BaseModel):
    """Distribution function, straight between its points."""

    slow_time: list[float]
    probability: list[float]


class ReliabilityClass(BaseModel):
    """Past statements whose probabilities lie between two limits, and what came of them."""

    low: float
    high: float
    stated: float = Field(description="Mean of the stated probabilities.")
    count: int = Field(description="Statements whose horizon has passed.")
    came_true: int
    effective: float = Field(
        description="How many independent statements they are worth, as they overlap."
    )
    lo: float = Field(description="95 % interval of how often such statements come true.")
    hi: float


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
    record: ReliabilityClass | None = Field(
        default=None, description="Past statements like this one; null where there are none."
    )
    sentence: str


class ForecastModel(BaseModel):
    """Where a twin is heading."""

    model_config = {"json_schema_extra": {"examples": [FORECAST_EXAMPLE]}}

    id: str
    since: float | None = Field(description="Slow time of the last reading.")
    horizon: float | None = Field(
        default=None, description="Slow time up to which all of it looks."
    )
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
        description="Slow times after which a quantity jumped."
    )
    valid: bool
    reasons: list[str]
    warnings: list[str] = Field(
        default=[], description="Of each quantity that no degradation law fits."
    )
    widening: dict[str, float] = Field(
        default={},
        description="Factor by which the futures of each quantity are spread wider than its "
        "laws say, as its past outlooks were too sure.",
    )
    record: list[str] = Field(
        default=[], description="What came of past outlooks, in sentences."
    )


class CoverageModel(BaseModel):
    """How often a central interval held."""

    stated: float
    count: int
    held: int
    lo: float = Field(description="95 % interval of the probability with which it holds.")
    hi: float


class WideningModel(BaseModel):
    """Factor by which the spread of futures is widened."""

    factor: float = 1.0
    probability: float = Field(
        default=0.5, description="Posterior probability that the spread was not right."
    )
    effective: float = Field(default=0.0, description="Independent statements behind it.")


class QuantityRecord(BaseModel):
    """What came of the bands of one quantity."""

    coverage: list[CoverageModel]
    widening: WideningModel
    sentences: list[str]


class ThresholdRecord(BaseModel):
    """What came of statements on thresholds."""

    count: int
    came_true: int
    effective: float
    brier: float | None = Field(description="Mean squared error of their probabilities.")
    classes: list[ReliabilityClass]
    sentences: list[str] = []


class StatedQuantity(BaseModel):
    """Quantiles of one quantity at some instants, as they were told."""

    instants: list[float]
    quantiles: list[list[float]] = Field(
        description="At each instant, at 2.5, 5, 10, 25, 50, 75, 90, 95 and 97.5 %."
    )
    widening: float


class StatedCrossing(BaseModel):
    """Probability that a threshold is reached, as it was told."""

    quantity: str
    threshold: float
    toward: Literal["below", "above"]
    within: float
    already: float


class PastOutlook(BaseModel):
    """What a twin stated of its future after one reading."""

    since: float
    horizon: float
    quantities: dict[str, StatedQuantity]
    crossings: list[StatedCrossing]


class TrackRecordModel(BaseModel):
    """Past outlooks of a twin, and what came of them."""

    id: str
    since: float | None = Field(
        description="Slow time of the last kept outlook, up to which the truth counts."
    )
    slow_time_unit: str | None
    kept: int
    quantities: dict[str, QuantityRecord]
    thresholds: ThresholdRecord
    outlooks: list[PastOutlook]
    sentences: list[str]
    reasons: list[str] = Field(description="Why there is nothing to compare yet.")
