"""Answers about alarms and their deliveries."""

from typing import Any, Literal

from pydantic import ConfigDict, Field

from .base import RestAnswer

DeliveryState = Literal["waiting", "late", "delivered", "failed", "dropped"]
"""`late`: of readings that were old on arrival, sent once newer ones say the same; `failed`:
given up; `dropped`: of no interest any more, such as a reminder of an alarm that has ended."""

EVENT_ID = "5f0c2a4e9b7d41c6a3e8f1d2b4c6978a"
ACKNOWLEDGED_EXAMPLE: dict[str, Any] = {
    "by": "Ann Moreau",
    "token": "ann",
    "note": "Inspected on site, bolts tightened.",
    "t_ns": 1795233700123456789,
}


class AcknowledgementModel(RestAnswer):
    """Who acknowledged an alarm, and when."""

    model_config = ConfigDict(json_schema_extra={"examples": [ACKNOWLEDGED_EXAMPLE]})

    by: str = Field(description="Who it is said to be.")
    token: str = Field(description="Whose token it was.")
    note: str
    t_ns: int = Field(description="By the server's clock [ns since 1970-01-01 UTC].")


class AcknowledgedModel(AcknowledgementModel):
    """Answer to an acknowledgement."""

    event_id: str = Field(examples=[EVENT_ID])


class AlarmModel(RestAnswer):
    """An event of severity `alarm`."""

    event_id: str = Field(
        description="The same after the history was estimated again.", examples=[EVENT_ID]
    )
    number: int
    kind: str = Field(examples=["alarm"])
    severity: Literal["alarm"]
    t_ns: int
    slow_time: float | None
    message: str
    raised: bool = Field(description="Whether it holds still.")
    acknowledged: AcknowledgementModel | None


class AlarmList(RestAnswer):
    """Alarms of a twin, the newest first."""

    id: str
    alarms: tuple[AlarmModel, ...]


class RouteModel(RestAnswer):
    """State of a route of a twin."""

    receiver: str
    kind: Literal["webhook", "email", "mqtt", "own"] | None = Field(
        description="null where no such receiver is declared."
    )
    waiting: int
    delivered: int = Field(description="Of those that are kept, see `alarms.kept_s`.")
    failed: int = Field(description="Given up; likewise.")
    last_error: str | None = Field(
        description="Why the last attempt failed; null where it succeeded, or there was none.",
        examples=["The receiver answered 503, and not from 200 to 299."],
    )


class DeliveryModel(RestAnswer):
    """An event on its way to a receiver."""

    id: str = Field(description="What the receiver tells doubles by.", examples=[EVENT_ID])
    event_id: str
    receiver: str
    kind: str
    severity: Literal["info", "warning", "alarm"]
    reminder: int = Field(description="0 for the first message, then 1, 2, ...")
    state: DeliveryState
    tries: int
    created_ns: int
    due_ns: int | None = Field(description="When it is tried next.")
    ended_ns: int | None
    error: str | None
    message: str


class DeliveryList(RestAnswer):
    """State of the routes of a twin, and its deliveries, the newest first."""

    id: str
    routes: tuple[RouteModel, ...]
    deliveries: tuple[DeliveryModel, ...]


class TrialModel(RestAnswer):
    """A test alarm that was sent."""

    event_id: str
    receivers: tuple[str, ...]
