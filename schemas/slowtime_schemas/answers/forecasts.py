"""Answers about the forecast of a twin."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from slowtime_schemas.keyed_access import KeyedAccess
from slowtime_schemas.quantities import Estimate

from .base import Extensible, RestAnswer

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


class ForecastPoint(KeyedAccess, RestAnswer):
    """Forecast at one slow time; null for quantities that are not estimated."""

    slow_time: float
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    elements: dict[str, Estimate] = Field(
        default={}, description="Of a twin of elements, each stiffness and mass by name."
    )


class CrossingTime(KeyedAccess, RestAnswer):
    """By when a threshold has been crossed with a probability."""

    share: float = Field(description="The probability.")
    slow_time: float | None = Field(description="null: not within the horizon.")
    ahead: float | None = Field(description="The same, from the last reading on.")


class DistributionModel(KeyedAccess, RestAnswer):
    """Distribution function, straight between its points."""

    slow_time: tuple[float, ...]
    probability: tuple[float, ...]


class ReliabilityClass(RestAnswer):
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


class CrossingModel(KeyedAccess, RestAnswer):
    """When a threshold is first crossed: a distribution."""

    model_config = ConfigDict(json_schema_extra={"examples": [CROSSING_EXAMPLE]})

    quantity: str
    threshold: float
    toward: Literal["below", "above"] | None = Field(
        description="Side that is asked for; null for the one where the quantity is not now."
    )
    source: Annotated[Literal["request", "alarm", "registration"], Extensible]
    times: tuple[CrossingTime, ...]
    quantiles: tuple[CrossingTime, ...] = Field(
        default=(), description="The same at 5, 10, 25, 50, 75, 90 and 95 %."
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


class ForecastModel(KeyedAccess, RestAnswer):
    """Where a twin is heading."""

    model_config = ConfigDict(json_schema_extra={"examples": [FORECAST_EXAMPLE]})
    TABLE: ClassVar[str] = "points"

    id: str
    since: float | None = Field(description="Slow time of the last reading.")
    horizon: float | None = Field(
        default=None, description="Slow time up to which all of it looks."
    )
    until: float | None = Field(description="Beyond this the forecast repeats its trend.")
    slow_time_unit: str | None
    points: tuple[ForecastPoint, ...]
    crossings: tuple[CrossingModel, ...] = Field(
        description="Of each threshold: the one asked for, those of the alarms, and those of "
        "the registration's `forecast.thresholds`."
    )
    periods: dict[str, float | None] = Field(
        description="After how long each quantity repeats itself; null where it does not."
    )
    jumps: dict[str, tuple[float, ...]] = Field(
        description="Slow times after which a quantity jumped."
    )
    valid: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...] = Field(
        default=(), description="Of each quantity that no degradation law fits."
    )
    widening: dict[str, float] = Field(
        default={},
        description="Factor by which the futures of each quantity are spread wider than its "
        "laws say, as its past outlooks were too sure.",
    )
    record: tuple[str, ...] = Field(
        default=(), description="What came of past outlooks, in sentences."
    )


class CoverageModel(RestAnswer):
    """How often a central interval held."""

    stated: float
    count: int
    held: int
    lo: float = Field(description="95 % interval of the probability with which it holds.")
    hi: float


class WideningModel(RestAnswer):
    """Factor by which the spread of futures is widened."""

    factor: float = 1.0
    probability: float = Field(
        default=0.5, description="Posterior probability that the spread was not right."
    )
    effective: float = Field(default=0.0, description="Independent statements behind it.")


class QuantityRecord(RestAnswer):
    """What came of the bands of one quantity."""

    coverage: tuple[CoverageModel, ...]
    widening: WideningModel
    sentences: tuple[str, ...]


class ThresholdRecord(RestAnswer):
    """What came of statements on thresholds."""

    count: int
    came_true: int
    effective: float
    brier: float | None = Field(description="Mean squared error of their probabilities.")
    classes: tuple[ReliabilityClass, ...]
    sentences: tuple[str, ...] = ()


class StatedQuantity(RestAnswer):
    """Quantiles of one quantity at some instants, as they were told."""

    instants: tuple[float, ...]
    quantiles: tuple[tuple[float, ...], ...] = Field(
        description="At each instant, at 2.5, 5, 10, 25, 50, 75, 90, 95 and 97.5 %."
    )
    widening: float


class StatedCrossing(RestAnswer):
    """Probability that a threshold is reached, as it was told."""

    quantity: str
    threshold: float
    toward: Literal["below", "above"]
    within: float
    already: float


class PastOutlook(RestAnswer):
    """What a twin stated of its future after one reading."""

    since: float
    horizon: float
    quantities: dict[str, StatedQuantity]
    crossings: tuple[StatedCrossing, ...]


class TrackRecordModel(RestAnswer):
    """Past outlooks of a twin, and what came of them."""

    id: str
    since: float | None = Field(
        description="Slow time of the last kept outlook, up to which the truth counts."
    )
    slow_time_unit: str | None
    kept: int
    quantities: dict[str, QuantityRecord]
    thresholds: ThresholdRecord
    outlooks: tuple[PastOutlook, ...]
    sentences: tuple[str, ...]
    reasons: tuple[str, ...] = Field(description="Why there is nothing to compare yet.")
