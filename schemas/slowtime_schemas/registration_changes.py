"""Changes of a twin's registration: ordered, kept with their author, and undone."""

from typing import Annotated, Any, Literal, Self, get_args

from pydantic import ConfigDict, Field, JsonValue, StringConstraints, model_validator

from .answers.base import RestAnswer
from .asset_events import PersonName
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

SETTABLE: tuple[SettableField, ...] = get_args(SettableField)

Values = Annotated[dict[SettableField, JsonValue], Field(max_length=len(SETTABLE)), Plain]
Number = Annotated[int, Field(ge=1, lt=2**63)]
Reason = Annotated[str, StringConstraints(max_length=2_000), Plain]

EXAMPLES: list[Any] = [
    {
        "before": {"alarms": []},
        "after": {"alarms": [{"quantity": "stiffness_change", "below": -0.1}]},
        "person": "Ann Moreau",
        "text": "Limit of the owner's handbook.",
    },
    {"reverses": 12, "person": "Ann Moreau"},
]


class RegistrationChangeOrder(Frozen):
    """New values of some fields of a registration, or a change to be undone."""

    model_config = ConfigDict(json_schema_extra={"examples": EXAMPLES})

    after: Annotated[
        Values, Field(description="New value of each field that is changed, as registered.")
    ] = Field(default_factory=dict)
    before: Annotated[
        Values,
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
    text: Annotated[Reason, Field(description="Reason of the change.")] = ""

    @model_validator(mode="after")
    def _changes_or_reverses(self) -> Self:
        if (self.reverses is None) != bool(self.after):
            given = "both" if self.after else "neither"
            raise ValueError(
                f"Of after and reverses, {given} was given. Give one of them: new values, or "
                "the number of a change to undo."
            )
        if self.reverses is not None and self.before:
            raise ValueError(
                "before was given with reverses. Leave it out: the kept values are compared."
            )
        return self


class FieldChange(RestAnswer):
    """A field of a registration before and after a change."""

    field: str = Field(examples=["alarms"])
    before: Any
    after: Any


class RegistrationChange(RestAnswer):
    """A change of a registration: who, when, and each field before and after it."""

    number: int = Field(description="Of the event that says so, within its twin.")
    t_ns: Nanoseconds
    person: str = Field(examples=["Ann Moreau"])
    principal: str = Field(description="Whose token it was.")
    text: str = ""
    changes: tuple[FieldChange, ...]
    others: tuple[str, ...] = Field(
        (), description="Fields that changed too and whose former values are not kept here."
    )
    reverses: int | None = Field(None, description="Number of the change that this undoes.")
    reversed_by: int | None = Field(None, description="Number of the change that undoes this.")


class RegistrationChanges(RestAnswer):
    """Changes of a twin's registration, the newest first."""

    id: str
    changes: tuple[RegistrationChange, ...]
