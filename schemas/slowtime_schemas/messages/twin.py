"""States, registrations and events of twins."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from slowtime_schemas.quantities import (
    Count,
    Covariates,
    Estimate,
    Finite,
    Flags,
    Free,
    Frozen,
    UnitName,
)

from .base import Message
from .features import Shape


class SeenMode(Frozen):
    """One mode as the twin took it in."""

    identity: Annotated[
        Count | None,
        Field(description="Lasting name within the boot; null for what is nobody's yet."),
    ] = None
    model_mode: Annotated[
        Count | None,
        Field(description="Which mode of the twin's model it is, 0 for the lowest."),
    ] = None
    frequency_hz: Estimate
    damping_ratio: Estimate | None
    kind: Literal["structural", "harmonic"] = "structural"
    shape: Shape | None = None


class TwinState(Message):
    """What the twin knows after one features message."""

    MESSAGE: ClassVar[str] = "state"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    id: str
    slow_time: Finite
    slow_time_unit: UnitName = "s"
    frequency_hz: Estimate | None
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    correlation: Annotated[
        float,
        Field(ge=-1, le=1, description="Between the errors of stiffness and mass change."),
    ] = 0.0
    assumed: Flags = ()
    frequency_used: Literal["measured", "smoothed"] = "measured"
    valid: bool
    reasons: Flags = ()
    truth: Covariates | None = None
    elements: Annotated[
        dict[str, Estimate],
        Field(
            max_length=4096,
            description="Relative change of each free stiffness, by element, and of each free "
            "mass, by node and `.mass`; -0.1 once a tenth is gone.",
        ),
    ] = Field(default_factory=dict)
    posterior_to_prior: Annotated[
        dict[str, Finite],
        Field(
            max_length=4096,
            description="Of each of `elements`: 1 where the readings said nothing, 0 if sure.",
        ),
    ] = Field(default_factory=dict)
    suspects: Annotated[
        Flags,
        Field(description="What has changed: 'j2'; 'j1 or j4' where the readings cannot tell."),
    ] = ()
    channels: Annotated[
        tuple[str, ...],
        Field(max_length=4096, description="Whose components the shapes hold, in order."),
    ] = ()
    modes: Annotated[tuple[SeenMode, ...], Field(max_length=64)] = ()


class Registered(Message):
    """What a twin was told of its structure; with the features, it makes the history anew."""

    MESSAGE: ClassVar[str] = "registration"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    id: str
    registration: Free


class Event(Message):
    """Something a person may want to know of, once."""

    MESSAGE: ClassVar[str] = "event"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    kind: Annotated[str, StringConstraints(min_length=1, max_length=64)]
    severity: Literal["info", "warning", "alarm"]
    slow_time: Finite | None = None
    message: str
    details: Free = Field(default_factory=dict)
