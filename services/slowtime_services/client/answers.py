"""Typed answers of a server; fields that a newer server adds are ignored."""

import datetime
from collections.abc import Iterable
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from slowtime_schemas.quantities import Estimate


class Answer(BaseModel):
    """Immutable."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class State(Answer):
    """State of a twin after one epoch; None for quantities that are not estimated."""

    id: str
    t_ns: int
    slow_time: float
    slow_time_unit: str
    frequency_hz: Estimate | None = None
    damping_ratio: Estimate | None = None
    stiffness_change: Estimate | None = None
    mass_change: Estimate | None = None
    correlation: float = 0.0
    assumed: tuple[str, ...] = ()
    valid: bool
    reasons: tuple[str, ...] = ()
    boot: str
    sequence: int
    missing_before: int = 0
    elements: dict[str, Estimate] = {}
    suspects: tuple[str, ...] = ()
    truth: dict[str, float] | None = None

    @property
    def time(self) -> datetime.datetime:
        """Sensor time to the microsecond; `t_ns` has all of it."""
        return _EPOCH + datetime.timedelta(microseconds=self.t_ns // 1000)


class Instants(Answer):
    """One instant of each bucket."""

    t_ns: tuple[int, ...]
    slow_time: tuple[float, ...]


class Range(Answer):
    """Extremes of a value in each bucket; None where there is nothing."""

    min: tuple[float | None, ...]
    max: tuple[float | None, ...]


class Band(Range):
    """Mean and extremes of a quantity in each bucket, and the ends of its 95 % intervals."""

    mean: tuple[float | None, ...]
    lo: tuple[float | None, ...]
    hi: tuple[float | None, ...]


class Bands(Answer):
    """Statistics of all readings of a span, in buckets of consecutive ones.

    Parameters
    ----------
    readings
        All of the span that was asked for.
    count, valid
        Of each bucket: its readings, and the valid ones among them.
    start, end
        First and last reading of each bucket.
    """

    readings: int
    slow_time_unit: str
    count: tuple[int, ...]
    valid: tuple[int, ...]
    start: Instants
    end: Instants
    quantities: dict[str, Band]
    elements: dict[str, Band] = {}
    truth: dict[str, Range] = {}


class History(list[State]):
    """States in order: all of a span, or a selection with statistics of all.

    Parameters
    ----------
    bands
        What all readings show, where the states are but some of them; else None.
    """

    def __init__(self, states: Iterable[State], bands: Bands | None = None) -> None:
        super().__init__(states)
        self.bands = bands


class Twin(Answer):
    """A twin: its latest state, or that at a moment; without times before its first epoch."""

    id: str
    t_ns: int | None = None
    slow_time: float | None = None
    frequency_hz: Estimate | None = None
    damping_ratio: Estimate | None = None
    stiffness_change: Estimate | None = None
    mass_change: Estimate | None = None
    valid: bool
    reasons: tuple[str, ...] = ()
    alive: bool
    elements: dict[str, Estimate] = {}
    suspects: tuple[str, ...] = ()
    nominal: dict[str, float] | None = None
    registration: dict[str, Any]


class ForecastPoint(Answer):
    """Forecast at one slow time."""

    slow_time: float
    stiffness_change: Estimate | None = None
    mass_change: Estimate | None = None
    elements: dict[str, Estimate] = {}


class CrossingTime(Answer):
    """By when a threshold has been crossed with a probability; None: not within the horizon."""

    share: float
    slow_time: float | None
    ahead: float | None


class Distribution(Answer):
    """Distribution function, straight between its points."""

    slow_time: tuple[float, ...] = ()
    probability: tuple[float, ...] = ()


class ReliabilityClass(Answer):
    """Past statements whose probabilities lie between two limits, and what came of them.

    Parameters
    ----------
    low, high
        Limits of the probabilities.
    stated
        Their mean.
    count, came_true
        Statements whose horizon has passed, and those that came true.
    effective
        How many independent statements they are worth, as they overlap.
    lo, hi
        95 % interval of how often such statements come true.
    """

    low: float
    high: float
    stated: float
    count: int
    came_true: int
    effective: float
    lo: float
    hi: float


class Crossing(Answer):
    """When a threshold is first crossed: a distribution.

    Parameters
    ----------
    times, quantiles
        By when it has been crossed with a probability: at 10, 50 and 90 %, and at more.
    median
        Slow time; None where `within` is below one half.
    cdf
        Probability that it has been crossed by each slow time.
    within, beyond, already
        Probability that it is crossed within the horizon, that it is not, and that it has been
        crossed by now.
    laws
        Degradation laws from which it follows, with their posterior probability.
    horizon
        Slow time up to which was looked.
    """

    quantity: str
    threshold: float
    times: tuple[CrossingTime, ...]
    quantiles: tuple[CrossingTime, ...] = ()
    median: float | None = None
    cdf: Distribution = Distribution()
    within: float
    beyond: float | None = None
    already: float
    laws: dict[str, float] = {}
    horizon: float | None = None
    record: ReliabilityClass | None = None
    sentence: str


class Forecast(Answer):
    """Where a twin is heading."""

    id: str
    since: float | None
    horizon: float | None = None
    until: float | None
    points: tuple[ForecastPoint, ...]
    crossings: tuple[Crossing, ...]
    valid: bool
    reasons: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    widening: dict[str, float] = {}
    record: tuple[str, ...] = ()


class Coverage(Answer):
    """How often a central interval held: stated probability, and a 95 % interval of it."""

    stated: float
    count: int
    held: int
    lo: float
    hi: float


class Widening(Answer):
    """Factor of the spread of futures, and the probability that the spread was not right."""

    factor: float = 1.0
    probability: float = 0.5
    effective: float = 0.0


class QuantityRecord(Answer):
    """What came of the bands of one quantity."""

    coverage: tuple[Coverage, ...]
    widening: Widening


class ThresholdRecord(Answer):
    """What came of statements on thresholds; `brier` is None where none has been decided."""

    count: int
    came_true: int
    effective: float
    brier: float | None
    classes: tuple[ReliabilityClass, ...]


class TrackRecord(Answer):
    """What came of the past outlooks of a twin, up to the slow time `since`."""

    id: str
    since: float | None
    kept: int
    quantities: dict[str, QuantityRecord]
    thresholds: ThresholdRecord
    sentences: tuple[str, ...]
    reasons: tuple[str, ...]


class PlanTime(Answer):
    """A time of a plan: from the last reading, in slow time, and in the calendar if known."""

    ahead: float
    slow_time: float
    t: str | None


class PlanCost(Answer):
    """Expected cost, and its 5 and 95 % quantiles over futures."""

    value: float
    lo: float
    hi: float


class PlanOption(Answer):
    """Something that may be done."""

    name: str
    words: str
    now: str
    cost: PlanCost
    failures: float
    parameters: dict[str, float]
    curve: tuple[float, ...]


class PlanInformation(Answer):
    """The value of an observation before it is made."""

    name: str
    at: PlanTime
    cost: float
    value: float
    net: float
    changes: float
    words: str


class LastOrder(Answer):
    """The last order of a repair that is in time."""

    status: str
    order: PlanTime | None
    effect: PlanTime | None
    probability: float
    by: str
    limit: float | None
    sentence: str


class MaintenancePlan(Answer):
    """Recommended action for a twin's structure, with date and reasons."""

    id: str
    since: float | None
    currency: str | None
    action: str | None
    decided: bool
    sentence: str
    last_order: LastOrder | None = None
    changes: tuple[str, ...]
    options: tuple[PlanOption, ...]
    times: tuple[PlanTime, ...]
    repair_cost: tuple[float, ...]
    failure_probability: tuple[float, ...]
    information: tuple[PlanInformation, ...]
    valid: bool
    reasons: tuple[str, ...]


class Probability(Answer):
    """A probability with its 5 to 95 % band."""

    value: float
    lo: float
    hi: float


class RiskNow(Answer):
    """A limit state at one slow time."""

    probability: Probability
    beta: float
    survival: Probability
    hazard: float


class LimitStateRisk(Answer):
    """Probability of failure by one limit state."""

    name: str
    kind: str
    accepted: float
    now: RiskNow | None
    within: Probability | None
    until: float | None
    sentence: str
    valid: bool
    reasons: tuple[str, ...]


class Risk(Answer):
    """Probability of failure of a twin."""

    id: str
    since: float | None
    horizon: float | None
    limit_states: tuple[LimitStateRisk, ...]
    valid: bool
    reasons: tuple[str, ...]


class FleetAsset(Answer):
    """One twin of a fleet's plan."""

    id: str
    action: str | None
    sentence: str
    net: float | None
    cost: float | None
    visit: bool


class FleetPlan(Answer):
    """Where inspection teams go within a window."""

    window_d: float
    visits: int
    currency: str | None
    sentence: str
    assets: tuple[FleetAsset, ...]


class Event(Answer):
    """An event for people."""

    number: int
    event_id: str = ""
    """The same after the history was estimated again; `number` is not."""
    id: str
    t_ns: int
    slow_time: float | None
    kind: str
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: dict[str, Any]


class AssetEvent(Answer):
    """A reported repair, replacement, inspection, load test or note of an asset."""

    event: str
    """Id that was given; one id is one event."""
    number: int
    kind: Literal["repair", "replacement", "inspection", "load_test", "note"]
    sentence: str
    quantity: str | None = None
    t_ns: int | None = None
    slow_time: float | None = None
    person: str
    principal: str
    accepted_ns: int
    text: str = ""
    repair: dict[str, Any] | None = None
    replacement: dict[str, Any] | None = None
    measured: dict[str, float] | None = None
    detection: dict[str, Any] | None = None
    conditions: dict[str, float] = {}
    reverses: str | None = None
    reversed_by: str | None = None
    answers: str | None = None


class Question(Answer):
    """A change that looks like an unreported repair."""

    event_id: str
    number: int
    t_ns: int
    message: str
    quantity: str
    since: float
    size: float
    sd: float
    answered_by: str | None = None


class AssetEvents(Answer):
    """Reported events of an asset, and questions of the twin; the newest first."""

    id: str
    events: tuple[AssetEvent, ...]
    questions: tuple[Question, ...]


class Digest(Answer):
    """One number for a whole history: equal where the histories are, to the last bit."""

    id: str
    sha256: str
    features: int


_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
