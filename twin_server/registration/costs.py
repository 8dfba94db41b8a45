"""Costs of an owner, the failure limit, and the repairs and inspections that can be ordered."""

import itertools
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from slowtime.decisions import Cost, Costs
from slowtime_schemas.quantities import Immutable, PlainText

from .thresholds import Number, Positive, Quantity

NotNegative = Annotated[float, Field(ge=0, lt=1e15, allow_inf_nan=False)]
Finite = Annotated[float, Field(gt=-1e15, lt=1e15, allow_inf_nan=False)]
TimeUnit = Literal["slow_time", "s", "h", "d", "month", "year"]

_YEAR_S = 86400.0 * 365.25
SECONDS: dict[TimeUnit, float] = {
    "s": 1.0,
    "h": 3600.0,
    "d": 86400.0,
    "month": _YEAR_S / 12,
    "year": _YEAR_S,
}
"""Of calendar units; a slow time of any unit is converted by the pace of the history."""


class CostLaw(Immutable):
    """A cost with a standard deviation; lognormal."""

    mean: NotNegative
    sd: NotNegative = 0.0

    @model_validator(mode="after")
    def _is_a_law(self) -> Self:
        if self.sd > 0 and self.mean == 0:
            raise ValueError(
                f"A cost of mean 0 and sd {self.sd:g} was given. Give a mean above 0, or no sd."
            )
        return self


Amount = NotNegative | CostLaw


def _cost(amount: float | CostLaw) -> Cost:
    if isinstance(amount, CostLaw):
        return Cost(amount.mean, amount.sd)
    return Cost(amount)


class CostTable(Immutable):
    """Costs, each a number or a law {mean, sd}, in one currency.

    Examples
    --------
    >>> CostTable(failure={"mean": 9e5, "sd": 3e5}, repair=4e4).costs().price(0)
    900000.0
    """

    currency: Annotated[PlainText, Field(min_length=1, max_length=16)] = "EUR"
    time_unit: Annotated[
        TimeUnit,
        Field(
            description="Of all times and rates in `costs` and `decision`: slow time as the "
            "sensor counts it, or the calendar."
        ),
    ] = "year"
    failure: Annotated[
        Amount, Field(description="Of one failure, the replacement that follows it included.")
    ]
    repair: Annotated[Amount, Field(description="Of one planned repair.")]
    inspection: Annotated[Amount, Field(description="Of one inspection.")] = 0.0
    downtime: Annotated[
        Amount, Field(description="Of being out of service, per `time_unit`.")
    ] = 0.0
    failure_downtime: Annotated[
        NotNegative, Field(description="Out of service after a failure.")
    ] = 0.0
    repair_downtime: NotNegative = 0.0
    inspection_downtime: NotNegative = 0.0
    closing: Annotated[
        Amount | None,
        Field(
            description="Of taking it out of service, once, for good or until a repair; null: "
            "it cannot be closed."
        ),
    ] = None
    closed: Annotated[
        Amount, Field(description="Of being closed from then on, per `time_unit`.")
    ] = 0.0
    discount_rate: Annotated[
        float,
        Field(
            ge=0,
            le=10,
            description="r: what is paid at t counts exp(-r t); per `time_unit`.",
        ),
    ] = 0.0

    def costs(self) -> Costs:
        """Convert to `slowtime.decisions.Costs`."""
        return Costs(
            failure=_cost(self.failure),
            repair=_cost(self.repair),
            inspection=_cost(self.inspection),
            downtime=_cost(self.downtime),
            closing=None if self.closing is None else _cost(self.closing),
            closed=_cost(self.closed),
            failure_downtime=self.failure_downtime,
            repair_downtime=self.repair_downtime,
            inspection_downtime=self.inspection_downtime,
            discount_rate=self.discount_rate,
        )


class FailureLimit(Immutable):
    """The value of a change at which the structure counts as failed."""

    quantity: Annotated[
        Quantity,
        Field(
            description="stiffness_change or mass_change; of a twin of elements, one of its "
            "parameters."
        ),
    ]
    below: Number | None = None
    above: Number | None = None

    @model_validator(mode="after")
    def _is_away_from_as_built(self) -> Self:
        if (self.below is None) == (self.above is None):
            raise ValueError(
                f"A failure of {self.quantity} has one limit. Give below or above, not both."
            )
        wrong = self.below if self.below is not None and self.below >= 0 else None
        wrong = self.above if self.above is not None and self.above <= 0 else wrong
        if wrong is not None:
            raise ValueError(
                f"A failure of {self.quantity} at {wrong:g} was given, where the structure is "
                "as built. Give `below` under 0, such as -0.3, or `above` over 0."
            )
        return self

    @property
    def at(self) -> float:
        """The value [1]."""
        value = self.above if self.below is None else self.below
        assert value is not None
        return value


class Inspecting(Immutable):
    """Error and cost of an inspection that can be ordered."""

    name: Annotated[PlainText, Field(min_length=1, max_length=60)] = "inspection"
    sd: Annotated[
        Positive | None,
        Field(description="Standard deviation of the change that it gives [1]."),
    ] = None
    detects_half: Annotated[
        Positive | None,
        Field(
            description="Instead of `sd`: the size of a change that it detects in one of two "
            "cases; it then says found or not found."
        ),
    ] = None
    detects_slope: Annotated[float, Field(gt=0, le=100)] = 4.0
    """Exponent s of the probability of detection d^s / (half^s + d^s)."""

    @model_validator(mode="after")
    def _measures_or_detects(self) -> Self:
        if (self.sd is None) == (self.detects_half is None):
            raise ValueError(
                "An inspection measures or detects. Give sd, or detects_half, not both."
            )
        return self


class MoreReadings(Immutable):
    """A sensor, or a series of readings, that may be added."""

    name: Annotated[PlainText, Field(min_length=1, max_length=60)]
    sd: Annotated[Positive, Field(description="Of the change from one of its readings [1].")]
    count: Annotated[int, Field(ge=1, le=100_000, description="Readings.")]
    every: Annotated[Positive, Field(description="Time between them, in `costs.time_unit`.")]
    cost: NotNegative = 0.0


Month = Annotated[int, Field(ge=1, le=12)]


class RepairAccess(Immutable):
    """When a repair can be done: months of the calendar, or windows of slow time."""

    months: Annotated[
        tuple[Month, ...],
        Field(
            max_length=12,
            description="Months (1 to 12, of the sensor clock in UTC) in which a repair can "
            "take effect, such as [5, 6, 7, 8, 9]; none given: every month.",
        ),
    ] = ()
    windows: Annotated[
        tuple[tuple[Finite, Finite], ...],
        Field(
            max_length=1000,
            description="Instead of months: beginning and end of each window, in slow time.",
        ),
    ] = ()

    @model_validator(mode="after")
    def _is_one_or_the_other(self) -> Self:
        if self.months and self.windows:
            raise ValueError("access has months and windows. Give one of them.")
        ends = [end for window in self.windows for end in window]
        if any(later < sooner for sooner, later in itertools.pairwise(ends)):
            raise ValueError(
                f"Windows {[list(window) for window in self.windows]} of access are out of "
                "order. Give each as [beginning, end], one after the other."
            )
        return self


class Deciding(Immutable):
    """Decisions about a twin: its failure limit, repairs and inspections."""

    failure: FailureLimit
    horizon: Annotated[
        Positive, Field(description="Until when costs count, in `costs.time_unit`.")
    ]
    restored: Annotated[
        float,
        Field(gt=0, le=1, description="Share of the damage that a repair takes away."),
    ] = 1.0
    lead_time: Annotated[
        NotNegative,
        Field(
            description="From the order of a repair to its effect (delivery, access, work), in "
            "`costs.time_unit`."
        ),
    ] = 0.0
    access: Annotated[RepairAccess, Field(description="When a repair can take effect.")] = (
        RepairAccess()
    )
    accepted: Annotated[
        float | None,
        Field(
            gt=0,
            lt=1,
            description="Accepted probability of a failure before a repair takes effect, by "
            "which the last safe day is judged; null: by the expected cost.",
        ),
    ] = None
    window: Annotated[
        Positive | None,
        Field(
            description="Within which a failure counts for the threshold on the probability of "
            "failure; by default a twelfth of the horizon."
        ),
    ] = None
    inspection: Inspecting | None = None
    sensors: Annotated[tuple[MoreReadings, ...], Field(max_length=8)] = ()


def months_of(text: str) -> tuple[int, ...]:
    """Read months, each or as a range that may pass the end of a year.

    Raises
    ------
    ValueError
        Where they are not numbers from 1 to 12.

    Examples
    --------
    >>> months_of("5-9"), months_of("11-2,6")
    ((5, 6, 7, 8, 9), (1, 2, 6, 11, 12))
    """
    found: set[int] = set()
    for part in text.split(","):
        ends = [end.strip() for end in part.split("-")]
        if len(ends) > 2 or not all(end in _MONTHS for end in ends):
            raise ValueError(
                f"Months {text!r:.40} were given. Give numbers from 1 to 12 and ranges, such "
                "as 5-9 or 4,5,9-11."
            )
        first, last = int(ends[0]), int(ends[-1])
        found |= {(first - 1 + k) % 12 + 1 for k in range((last - first) % 12 + 1)}
    return tuple(sorted(found))


_MONTHS = {str(month) for month in range(1, 13)}


class RepairTerms(NamedTuple):
    """Terms of a repair to plan with instead of those registered; None keeps one as it is."""

    lead_time: float | None = None
    months: str | None = None
    accepted: float | None = None

    def changed(self, decision: Deciding) -> Deciding:
        """Put them into what was registered.

        Raises
        ------
        ValueError
            Where one is not allowed.
        """
        given: dict[str, Any] = {"lead_time": self.lead_time, "accepted": self.accepted}
        kept = {name: value for name, value in given.items() if value is not None}
        if self.months is not None:
            kept["access"] = {"months": months_of(self.months)}
        return Deciding.model_validate(decision.model_dump() | kept)


COSTS_EXAMPLE: dict[str, Any] = {
    "currency": "EUR",
    "time_unit": "year",
    "failure": {"mean": 900000.0, "sd": 200000.0},
    "repair": 40000.0,
    "inspection": 1500.0,
    "discount_rate": 0.03,
}
DECISION_EXAMPLE: dict[str, Any] = {
    "failure": {"quantity": "stiffness_change", "below": -0.3},
    "horizon": 10.0,
    "inspection": {"name": "ultrasound", "sd": 0.01},
}
