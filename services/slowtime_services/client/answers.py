"""What a server answers, typed; what a newer server says beside it is passed over."""

import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from slowtime_schemas.quantities import Estimate


class Answer(BaseModel):
    """Immutable."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class State(Answer):
    """What a twin knew after one epoch; None for what is not estimated."""

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
    """What is expected at one slow time."""

    slow_time: float
    stiffness_change: Estimate | None = None
    mass_change: Estimate | None = None
    elements: dict[str, Estimate] = {}


class CrossingTime(Answer):
    """By when a threshold has been crossed with a probability; None: not within the horizon."""

    share: float
    slow_time: float | None
    ahead: float | None


class Crossing(Answer):
    """When a threshold is first crossed."""

    quantity: str
    threshold: float
    times: tuple[CrossingTime, ...]
    within: float
    already: float
    sentence: str


class Forecast(Answer):
    """Where a twin is heading."""

    id: str
    since: float | None
    until: float | None
    points: tuple[ForecastPoint, ...]
    crossings: tuple[Crossing, ...]
    valid: bool
    reasons: tuple[str, ...]


class Event(Answer):
    """Something a person may want to know of, once."""

    number: int
    event_id: str = ""
    """The same after the history was estimated anew; `number` is not."""
    id: str
    t_ns: int
    slow_time: float | None
    kind: str
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: dict[str, Any]


class Digest(Answer):
    """One number for a whole history: equal where the histories are, to the last bit."""

    id: str
    sha256: str
    features: int


_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
