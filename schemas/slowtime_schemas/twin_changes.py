"""Changes of a twin's registration and recorded events: kept with their author, and undone."""

from typing import Annotated, Any, Literal, Self, get_args

from pydantic import ConfigDict, Field, JsonValue, model_validator

from .answers.base import RestAnswer
from .asset_events import EventName, PersonName, Text
from .quantities import Frozen, Nanoseconds, Plain

SettableField = Literal[
    "name",
    "alarms",
    "alarm_routes",
    "confirm_readings",
    "forecast",
    "costs",
    "decision",
    "limit_states",
]
"""Fields of a registration that are changed one by one, and whose former values are kept."""

CorrectableField = Literal[
    "kind",
    "quantity",
    "at",
    "slow_time",
    "text",
    "repair",
    "replacement",
    "measured",
    "detection",
    "conditions",
]
"""Fields of a recorded event that are corrected."""

SETTABLE: tuple[SettableField, ...] = get_args(SettableField)
CORRECTABLE: tuple[CorrectableField, ...] = get_args(CorrectableField)

Before = Annotated[dict[SettableField, JsonValue], Field(max_length=len(SETTABLE)), Plain]
After = Annotated[
    dict[SettableField | CorrectableField, JsonValue],
    Field(max_length=max(len(SETTABLE), len(CORRECTABLE))),
    Plain,
]
Number = Annotated[int, Field(ge=1, lt=2**63)]

EXAMPLES: list[Any] = [
    {
        "before": {"alarms": []},
        "after": {"alarms": [{"quantity": "stiffness_change", "below": -0.1}]},
        "person": "Ann Moreau",
        "text": "Limit of the owner's handbook.",
    },
    {
        "event": "work-order-118",
        "after": {"repair": {"restored_share": 0.6, "restored_share_sd": 0.1}},
        "person": "Ann Moreau",
        "text": "Two of the bolts were not replaced.",
    },
    {"reverses": 12, "person": "Ann Moreau"},
]


class TwinChangeOrder(Frozen):
    """New values of fields of a registration or of a recorded event, or a change to undo."""

    model_config = ConfigDict(json_schema_extra={"examples": EXAMPLES})

    event: Annotated[
        EventName | None,
        Field(description="Recorded event to be corrected; null changes the registration."),
    ] = None
    after: Annotated[
        After,
        Field(
            description="New value of each field that is changed, as registered or recorded; "
            "other fields stay as they are."
        ),
    ] = Field(default_factory=dict)
    before: Annotated[
        Before,
        Field(
            description="Values that the author has seen; refused if they are others now. A "
            "field that is left out is changed whatever it is."
        ),
    ] = Field(default_factory=dict)
    reverses: Annotated[
        Number | None, Field(description="Instead of `after`: number of a change to undo.")
    ] = None
    person: Annotated[
        PersonName | None,
        Field(description="Who changes it; by default the name of the token."),
    ] = None
    text: Annotated[Text, Field(description="Reason of the change.")] = ""

    @model_validator(mode="after")
    def _changes_or_reverses(self) -> Self:
        if (self.reverses is None) != bool(self.after):
            given = "both" if self.after else "neither"
            raise ValueError(
                f"Of after and reverses, {given} was given. Give one of them: new values, or "
                "the number of a change to undo."
            )
        beside = "before" if self.before else None if self.event is None else "event"
        if self.reverses is not None and beside is not None:
            raise ValueError(
                f"{beside} was given with reverses. Leave it out: the number says what was "
                "changed, and the kept values are compared."
            )
        if self.event is not None and self.before:
            raise ValueError(
                "before was given with event. Leave it out: an event that somebody else has "
                "corrected has another id by then."
            )
        allowed = SETTABLE if self.event is None else CORRECTABLE
        other = [name for name in self.after if name not in allowed]
        if other:
            of = "a registration" if self.event is None else "a recorded event"
            raise ValueError(
                f"after has {', '.join(other)}, which is no field of {of} that is changed. "
                f"Allowed: {', '.join(allowed)}."
            )
        return self


class FieldChange(RestAnswer):
    """A field of a registration or of a recorded event before and after a change."""

    field: str = Field(examples=["alarms"])
    before: Any
    after: Any


class TwinChange(RestAnswer):
    """A change of a twin: who, when, and each field before and after it."""

    number: int = Field(description="Of the event that says so, within its twin.")
    t_ns: Nanoseconds
    person: str = Field(examples=["Ann Moreau"])
    principal: str = Field(description="Whose token it was.")
    text: str = ""
    changes: tuple[FieldChange, ...]
    others: tuple[str, ...] = Field(
        (), description="Fields that changed too and whose former values are not kept here."
    )
    event: str | None = Field(
        None, description="Recorded event that it corrects; null of the registration."
    )
    recorded_as: str | None = Field(
        None, description="Event that holds instead of the corrected one."
    )
    reverses: int | None = Field(None, description="Number of the change that this undoes.")
    reversed_by: int | None = Field(None, description="Number of the change that undoes this.")


class TwinChanges(RestAnswer):
    """Changes of a twin's registration and recorded events, the newest first."""

    id: str
    changes: tuple[TwinChange, ...]
