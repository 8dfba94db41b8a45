"""Requests and answers about alarms and their deliveries."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from slowtime_schemas.quantities import Plain
from twin_server.events.deliveries import State
from twin_server.events.receivers import ReceiverName
from twin_server.orders import Frozen

EVENT_ID = "5f0c2a4e9b7d41c6a3e8f1d2b4c6978a"
ACKNOWLEDGED_EXAMPLE: dict[str, Any] = {
    "by": "Ann Moreau",
    "token": "ann",
    "note": "Inspected on site, bolts tightened.",
    "t_ns": 1795233700123456789,
}


class AcknowledgementOrder(Frozen):
    """Who acknowledges an alarm, with a comment."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={"examples": [{"by": "Ann Moreau", "note": "On my way."}]},
    )

    by: Annotated[
        Annotated[str, Field(min_length=1, max_length=100), Plain] | None,
        Field(description="A name; by default that of the token."),
    ] = None
    note: Annotated[str, Field(max_length=1_000), Plain] = ""


class TestAlarmOrder(Frozen):
    """The receiver of a test alarm."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={"examples": [{"receiver": "ops"}, {}]},
    )

    receiver: Annotated[
        ReceiverName | None, Field(description="null for all receivers of the twin's routes.")
    ] = None


class AcknowledgementModel(BaseModel):
    """Who acknowledged an alarm, and when."""

    model_config = {"json_schema_extra": {"examples": [ACKNOWLEDGED_EXAMPLE]}}

    by: str = Field(description="Who it is said to be.")
    token: str = Field(description="Whose token it was.")
    note: str
    t_ns: int = Field(description="By the server's clock [ns since 1970-01-01 UTC].")


class AcknowledgedModel(AcknowledgementModel):
    """Answer to an acknowledgement."""

    event_id: str = Field(examples=[EVENT_ID])


class AlarmModel(BaseModel):
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


class AlarmList(BaseModel):
    """Alarms of a twin, the newest first."""

    id: str
    alarms: list[AlarmModel]


class RouteModel(BaseModel):
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


class DeliveryModel(BaseModel):
    """An event on its way to a receiver."""

    id: str = Field(description="What the receiver tells doubles by.", examples=[EVENT_ID])
    event_id: str
    receiver: str
    kind: str
    severity: Literal["info", "warning", "alarm"]
    reminder: int = Field(description="0 for the first message, then 1, 2, ...")
    state: State
    tries: int
    created_ns: int
    due_ns: int | None = Field(description="When it is tried next.")
    ended_ns: int | None
    error: str | None
    message: str


class DeliveryList(BaseModel):
    """State of the routes of a twin, and its deliveries, the newest first."""

    id: str
    routes: list[RouteModel]
    deliveries: list[DeliveryModel]


class TrialModel(BaseModel):
    """A test alarm that was sent."""

    event_id: str
    receivers: list[str]
