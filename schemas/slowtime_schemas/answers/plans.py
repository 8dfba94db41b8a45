"""Answers about maintenance plans."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from .base import Extensible, RestAnswer

PLAN_EXAMPLE: dict[str, Any] = {
    "id": "demo.tower",
    "name": "Tower",
    "since": 812.5,
    "currency": "EUR",
    "costs": {
        "failure": {"mean": 900000.0, "sd": 200000.0},
        "repair": {"mean": 40000.0, "sd": 0.0},
        "inspection": {"mean": 1500.0, "sd": 0.0},
        "downtime": {"mean": 0.0, "sd": 0.0},
        "closing": None,
        "closed": {"mean": 0.0, "sd": 0.0},
        "failure_downtime": 0.0,
        "repair_downtime": 0.0,
        "inspection_downtime": 0.0,
        "discount_rate": 0.03,
    },
    "months": [],
    "time_unit": "year",
    "slow_time_unit": "d",
    "seconds": 31557600.0,
    "horizon": {"ahead": 10.0, "slow_time": 4462.5, "t": "2036-11-21T04:00:00+00:00"},
    "failure": {
        "quantity": "stiffness_change",
        "threshold": -0.3,
        "toward": "below",
        "already": 0.0,
        "within": 0.62,
        "estimate": {"value": -0.187, "sd": 0.012},
    },
    "action": "wait",
    "decided": True,
    "sentence": "Repair once the estimate reaches 85 % of failure, expected in 2.1 years "
    "(2028-12-28): expected cost 61,200 EUR in 10 years (2036-11-21); the alternative “repair "
    "now” costs 12,400 EUR more. Without a repair it fails within that time with probability "
    "62 %.",
    "last_order": {
        "status": "due",
        "order": {"ahead": 2.1, "slow_time": 1579.5, "t": "2028-12-28T00:00:00+00:00"},
        "lo": {"ahead": 2.0, "slow_time": 1543.0, "t": "2028-11-21T00:00:00+00:00"},
        "hi": {"ahead": 2.3, "slow_time": 1652.5, "t": "2029-03-11T00:00:00+00:00"},
        "effect": {"ahead": 2.6, "slow_time": 1762.0, "t": "2029-06-28T00:00:00+00:00"},
        "probability": 0.018,
        "by": "probability",
        "limit": 0.02,
        "now_effect": {"ahead": 0.5, "slow_time": 995.0, "t": "2027-05-22T00:00:00+00:00"},
        "now_probability": 0.0,
        "lead_time": 0.5,
        "sentence": "Last safe day to order a repair: in 2.1 years (2028-12-28) (90 % "
        "interval: 2 years to 2.3 years), to be done in 2.6 years (2029-06-28). If the repair "
        "is ordered on that day, a failure before it takes effect has the probability 2 %. The "
        "accepted probability is 2 %, from the last reading until a repair takes effect.",
    },
    "changes": [
        "“repair now” is better if a failure costs more than 2,100,000 EUR (given: 900,000 "
        "EUR)."
    ],
    "options": [
        {
            "name": "estimate_threshold",
            "words": "repair once the estimate reaches 85 % of failure",
            "now": "wait",
            "cost": {"value": 61200.0, "lo": 38000.0, "hi": 93000.0},
            "failures": 0.004,
            "parameters": {"damage": 0.85},
            "repair": None,
            "curve": [0.0, 61200.0],
        }
    ],
    "times": [
        {"ahead": 0.0, "slow_time": 812.5, "t": "2026-11-21T04:00:00+00:00"},
        {"ahead": 10.0, "slow_time": 4462.5, "t": "2036-11-21T04:00:00+00:00"},
    ],
    "history": [
        {"ahead": -2.0, "value": -0.11, "sd": 0.012},
        {"ahead": -1.0, "value": -0.15, "sd": 0.012},
        {"ahead": 0.0, "value": -0.19, "sd": 0.012},
    ],
    "outlook": [
        {"value": -0.187, "lo": -0.207, "hi": -0.167},
        {"value": -0.33, "lo": -0.52, "hi": -0.24},
    ],
    "repair_cost": [73600.0, 540000.0],
    "failure_probability": [0.0, 0.62],
    "difference": {
        "best": "repair once the estimate reaches 85 % of failure",
        "other": "repair now",
        "value": 12400.0,
        "lo": 9100.0,
        "hi": 15800.0,
    },
    "break_even": [{"item": "failure", "given": 900000.0, "at": 2100000.0}],
    "information": [
        {
            "name": "ultrasound",
            "kind": "inspection",
            "at": {"ahead": 1.4, "slow_time": 1323.5, "t": "2028-04-15T10:00:00+00:00"},
            "count": 1,
            "cost": 1500.0,
            "value": 4100.0,
            "net": 2600.0,
            "changes": 0.22,
            "words": "ultrasound within 1.4 years (2028-04-15), worth 2,600 EUR net",
        }
    ],
    "inspections": [],
    "valid": True,
    "reasons": [],
}

Now = Literal["repair", "inspect", "close", "wait", "undecided"]


class PlanTime(RestAnswer):
    """A time of a plan."""

    ahead: float = Field(description="From the last reading, in `time_unit`.")
    slow_time: float
    t: str | None = Field(description="RFC 3339; null where the calendar is not known.")


class PlanEstimate(RestAnswer):
    """The quantity that fails at the last reading, as a relative change."""

    value: float
    sd: float = Field(description="Standard deviation.")


class PlanFailure(RestAnswer):
    """The definition of failure, and its probability without a repair."""

    quantity: str
    threshold: float
    toward: Literal["below", "above"]
    already: float = Field(description="Probability that it counts as failed by now.")
    within: float = Field(description="Probability of a failure within the horizon.")
    estimate: PlanEstimate | None = Field(
        None, description="Present value of `quantity`; null from versions without it."
    )


class PlanReading(RestAnswer):
    """A valid reading of the quantity that fails, as a relative change."""

    ahead: float = Field(description="From the last reading, in `time_unit`: at most 0.")
    value: float
    sd: float = Field(description="Standard deviation.")


class PlanOutlook(RestAnswer):
    """The forecast of the quantity that fails without a repair, as a relative change."""

    value: float = Field(description="Median of the futures.")
    lo: float = Field(description="1 of 20 futures is below.")
    hi: float = Field(description="1 of 20 futures is above.")


class PlanCost(RestAnswer):
    """Expected cost, and the range of 9 of 10 futures: 1 in 20 costs less, 1 in 20 more."""

    value: float
    lo: float
    hi: float


class PlanAmount(RestAnswer):
    """A cost as the owner states it: mean, and standard deviation, 0 if it is certain."""

    mean: float
    sd: float


class PlanCosts(RestAnswer):
    """All costs that a plan counts, in its currency; times in its `time_unit`."""

    failure: PlanAmount = Field(description="Of one failure.")
    repair: PlanAmount = Field(description="Of one planned repair.")
    inspection: PlanAmount = Field(description="Of one inspection.")
    downtime: PlanAmount = Field(description="Of being out of service, per `time_unit`.")
    closing: PlanAmount | None = Field(
        description="Of taking it out of service, once, for good or until a repair; null: "
        "it cannot be closed."
    )
    closed: PlanAmount = Field(description="Of being closed, per `time_unit`.")
    failure_downtime: float = Field(description="Out of service after a failure.")
    repair_downtime: float
    inspection_downtime: float
    discount_rate: float = Field(description="Per `time_unit`.")


class PlanOption(RestAnswer):
    """Something that may be done."""

    name: str = Field(
        description="nothing, age, fixed_interval, estimate_threshold, probability_threshold, "
        "periodic_inspection, repair_now, repair_at, inspect_now, inspect_at, read_on, close "
        "or close_until_repair."
    )
    words: str
    now: Annotated[Now, Extensible] = Field(description="What it does at once.")
    cost: PlanCost
    failures: float = Field(description="Expected discounted number of failures.")
    parameters: dict[str, float] = Field(
        description="Times from now in `time_unit`: `order` of a repair, and `at`, when it "
        "takes effect; damage as a share of that at failure."
    )
    repair: tuple[PlanTime | None, ...] | None = Field(
        description="By when 5, 50 and 95 % of the futures have been repaired; null beyond the "
        "horizon, or where it hangs on an inspection."
    )
    curve: tuple[float, ...] = Field(description="Expected cost until each of `times`.")


class PlanLastOrder(RestAnswer):
    """The last order of a repair that is in time."""

    status: Annotated[Literal["due", "passed", "beyond"], Extensible] = Field(
        description="due: to come; passed: before the last reading; beyond: none is needed "
        "within the horizon."
    )
    order: PlanTime | None = Field(description="Of the order; null if beyond.")
    lo: PlanTime | None = Field(
        description="Lower end of the 90 % interval by the sampling error of the futures."
    )
    hi: PlanTime | None = Field(description="Upper end; null if beyond the horizon.")
    effect: PlanTime | None = Field(description="When the repair takes effect.")
    probability: float = Field(
        description="Of a failure before that effect; if beyond, within the horizon."
    )
    by: Annotated[Literal["probability", "cost"], Extensible] = Field(
        description="probability: the last order by which that of a failure is accepted; cost: "
        "the last before the expected cost rises."
    )
    limit: float | None = Field(description="Accepted probability; null if by cost.")
    now_effect: PlanTime | None = Field(description="Of a repair that is ordered now.")
    now_probability: float = Field(description="Of a failure before `now_effect`.")
    lead_time: float = Field(description="From order to effect, in `time_unit`.")
    sentence: str


class PlanDifference(RestAnswer):
    """The best option against the best of those that do something else now."""

    best: str
    other: str
    value: float
    lo: float = Field(
        description="Lower end of the 90 % interval; below 0, it cannot be decided."
    )
    hi: float


class PlanBreakEven(RestAnswer):
    """At which cost of one item both options of `difference` cost the same."""

    item: str
    given: float
    at: float


class PlanInformation(RestAnswer):
    """The value of an observation before it is made."""

    name: str
    kind: Annotated[Literal["inspection", "detection", "readings"], Extensible]
    at: PlanTime
    count: int
    cost: float
    value: float = Field(
        description="Among what may still be done then; at least 0, up to rounding."
    )
    net: float = Field(
        description="By how much the expected cost falls, its own cost included; negative "
        "where it is not worth its cost, or comes too late."
    )
    changes: float = Field(description="Probability that it changes what is done.")
    words: str


class PlanModel(RestAnswer):
    """Recommended action for a twin's structure: date, reasons, and what would change it."""

    model_config = ConfigDict(json_schema_extra={"examples": [PLAN_EXAMPLE]})
    TABLE: ClassVar[str] = "options"

    id: str
    name: str = Field("", description="Of the structure, as registered.")
    since: float | None = Field(description="Slow time of the last reading.")
    currency: str | None
    costs: PlanCosts | None = Field(None, description="Null where there is no plan.")
    months: tuple[int, ...] = Field(
        (), description="In which a repair can take effect; empty: in every month."
    )
    time_unit: str | None
    slow_time_unit: str | None = Field(
        None, description="Of slow time, as the edge names it: T0 is one natural period."
    )
    seconds: float | None = Field(
        description="In one `time_unit`; null where the calendar is not known."
    )
    horizon: PlanTime | None
    failure: PlanFailure | None
    action: Annotated[Now, Extensible] | None
    decided: bool
    sentence: str
    last_order: PlanLastOrder | None = None
    changes: tuple[str, ...]
    options: tuple[PlanOption, ...] = Field(description="The cheapest first.")
    times: tuple[PlanTime, ...]
    history: tuple[PlanReading, ...] = Field(
        (),
        description="Valid readings of what fails, evenly thinned; empty from versions "
        "without it.",
    )
    outlook: tuple[PlanOutlook, ...] = Field(
        (), description="At each of `times`; empty from versions without it."
    )
    repair_cost: tuple[float, ...] = Field(
        description="Expected cost of a repair at each of `times`."
    )
    failure_probability: tuple[float, ...]
    difference: PlanDifference | None
    break_even: tuple[PlanBreakEven, ...]
    information: tuple[PlanInformation, ...] = Field(description="Of largest net value first.")
    inspections: tuple[PlanInformation, ...] = Field(
        description="An inspection at several times."
    )
    valid: bool
    reasons: tuple[str, ...]


FLEET_EXAMPLE: dict[str, Any] = {
    "window_d": 30.0,
    "visits": 1,
    "budget": None,
    "currency": "EUR",
    "sentence": "Inspect within 30 days: demo.tower (ultrasound, worth 2,600 EUR net).",
    "assets": [
        {
            "id": "demo.tower",
            "action": "wait",
            "sentence": PLAN_EXAMPLE["sentence"],
            "inspection": "ultrasound",
            "at": PLAN_EXAMPLE["information"][0]["at"],
            "net": 2600.0,
            "cost": 1500.0,
            "visit": True,
        }
    ],
    "without": [{"id": "demo.frame", "reason": "There is nothing to decide: …"}],
}


class FleetAsset(RestAnswer):
    """One twin of a fleet's plan."""

    id: str
    action: Annotated[Now, Extensible] | None
    sentence: str
    inspection: str | None
    at: PlanTime | None
    net: float | None = Field(
        description="Of an inspection within the window; null where none can be ordered."
    )
    cost: float | None
    visit: bool = Field(description="Whether a team is sent.")


class FleetWithout(RestAnswer):
    """A twin that is not ranked, and why."""

    id: str
    reason: str


class FleetPlanModel(RestAnswer):
    """Where the inspection teams go within a window."""

    model_config = ConfigDict(json_schema_extra={"examples": [FLEET_EXAMPLE]})

    window_d: float
    visits: int
    budget: float | None
    currency: str | None
    sentence: str
    assets: tuple[FleetAsset, ...] = Field(
        description="Those to be visited first, then those to be repaired, then by net value."
    )
    without: tuple[FleetWithout, ...]
