"""Health of edge agents, what they are, and acknowledgements of the twin."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from slowtime_schemas.quantities import (
    Count,
    Counters,
    Free,
    Frozen,
    Nanoseconds,
    Seconds,
    Sequence,
    StorableSequence,
)

from .base import Message

ACK_VERSION = "ack_version"
"""Counter of `Health`: newest version of `Acknowledgement` the agent reads; 1 if absent."""

FOREIGN_ACKS = "foreign_acks"
"""Counter of `Health`: acknowledgements of readings that another agent must have made."""


LinkProfile = Literal["lab", "field", "metered"]
"""What a link may cost: nothing to speak of, little, or every byte."""


class Link(Frozen):
    """When an agent sends what, so that its silence is not taken for a fault.

    Times are the longest that a healthy agent lets pass while it is connected.
    """

    profile: Annotated[
        LinkProfile,
        Field(description="Profile whose defaults the agent uses; single settings may differ."),
    ] = "lab"
    health_within_s: Annotated[
        Seconds, Field(description="Longest time from one health message to the next [s].")
    ]
    features_within_s: Annotated[
        Seconds,
        Field(description="Longest time that features wait at the agent before they are sent."),
    ] = 0.0
    offline_within_s: Annotated[
        Seconds,
        Field(description="Time after which an agent that has become silent is offline [s]."),
    ]
    waiting: Annotated[Count, Field(description="Features that wait to be sent.")] = 0
    held_until_ns: Annotated[
        Nanoseconds | None,
        Field(description="When they are sent, where send hours or the budget hold them back."),
    ] = None
    month_bytes: Annotated[
        Count,
        Field(description="Estimated bytes of this calendar month (UTC), in both directions."),
    ] = 0
    budget_bytes: Annotated[
        Count | None, Field(description="Bytes that a month may take; null without a budget.")
    ] = None


class Health(Message):
    """How an edge agent is doing; also the tail of its account (`last_sequence`)."""

    MESSAGE: ClassVar[str] = "health"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    last_sequence: Annotated[
        int,
        Field(
            ge=-1,
            lt=2**63,
            description="Newest features sequence of this boot that was sent; -1 before the "
            "first.",
        ),
        StorableSequence,
    ]
    first_held: Annotated[
        int,
        Field(
            ge=-1,
            lt=2**63,
            description="Oldest features sequence of this boot still in the spool; -1 if none.",
        ),
        StorableSequence,
    ]
    dropped: Annotated[
        int, Field(ge=0, lt=2**63, description="Features the full spool has dropped unsent.")
    ] = 0
    uptime_s: Seconds
    counters: Counters = Field(default_factory=dict)
    link: Annotated[
        Link | None,
        Field(description="Null of an agent that sends everything as it is made."),
    ] = None


class About(Message):
    """What an edge agent is: its software and the settings that decide its features."""

    MESSAGE: ClassVar[str] = "about"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    software: str
    settings: Free


class Acknowledgement(Message):
    """The twin's word that features are durable, up to and including `sequence` of `boot`.

    An agent whose own features from `first` to `sequence` have another digest deletes nothing:
    another agent sends under its name.
    """

    MESSAGE: ClassVar[str] = "ack"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    first: Annotated[
        Sequence | None,
        Field(description="From where on `digest` counts; null where there is none."),
    ] = None
    digest: Annotated[
        Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16}$")] | None,
        Field(
            description="Sum modulo 2^64, in hexadecimal, of the digests of the features from "
            "`first` to `sequence`: BLAKE2b of 8 bytes of each payload, little-endian, keyed "
            "with its sequence as 8 bytes, little-endian."
        ),
    ] = None
