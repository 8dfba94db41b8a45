"""Types that all messages share: names, numbers with standard deviation, free-form content."""

import math
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeFloat,
    StringConstraints,
    ValidationInfo,
)

from .keyed_access import KeyedAccess
from .plain_text import plain_throughout

AS_STORED = {"names": "as stored"}
"""Context of validation for what was taken in before names were held to plain text."""


def _as_plain_number(value: Any, info: ValidationInfo) -> Any:
    return value if info.context == AS_STORED else plain_throughout(value)


# Before other rules of a text, whose errors would not name the character.
Plain = BeforeValidator(_as_plain_number)
"""Marks a value whose keys and texts have no control, bidirectional or invisible characters."""
PlainText = Annotated[str, Plain]

Name = Annotated[
    str,
    StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$"),
    Field(description="Lower-case letters, digits, '-' and '_', at most 63; part of a key."),
]
"""A site or an asset."""

BootId = Annotated[
    str,
    StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._-]{0,63}$"),
    Field(description="One run of one edge agent; sequence numbers start again with each."),
]

Nanoseconds = Annotated[int, Field(ge=0, lt=2**63, description="Since 1970-01-01 UTC [ns].")]

SEQUENCES = 2**40
"""Sequences are smaller than this: a store keeps features by the number of their boot and 40
bits of sequence. At a thousand features a second, that is 35 years of one boot."""

MOST_COUNTERS = 256
"""Counters of one message; an edge agent has some twenty."""
LONGEST_COUNTER = 100
"""Characters in the name of a counter; the longest of an edge agent has 25."""

LONGEST_S = 2.0**63 / 1e9
"""Longest time that can be stated [s]: as long as nanoseconds since 1970 can be counted."""


def _below_sequences(value: int) -> int:
    # Not in the JSON Schema, whose frozen versions allow 63 bits; no agent comes near either.
    if value >= SEQUENCES:
        raise ValueError(
            f"A sequence of {value} was given. Allowed: below 2^40. Number the messages of a "
            "boot from 0."
        )
    return value


StorableSequence = AfterValidator(_below_sequences)
"""Marks a sequence, or a number that stands for one, that a store can keep."""

Sequence = Annotated[
    int,
    Field(ge=0, lt=2**63, description="Counts a stream's messages within a boot."),
    StorableSequence,
]
Finite = FiniteFloat
Sd = Annotated[NonNegativeFloat, Field(allow_inf_nan=False, description="Standard deviation.")]


LEAST_RATE_HZ, MOST_RATE_HZ = 1e-6, 1e8
"""Sampling rates that are believed [Hz]: from a sample in eleven days to the fastest digitizers
of acoustic emission. Receivers make room for what a rate and a duration ask for."""


def _believed_rate(rate_hz: float) -> float:
    if not LEAST_RATE_HZ <= rate_hz <= MOST_RATE_HZ:
        raise ValueError(
            f"A rate of {rate_hz:g} Hz was given. Allowed: {LEAST_RATE_HZ:g} to "
            f"{MOST_RATE_HZ:g}. Give samples per second."
        )
    return rate_hz


BelievedRate = AfterValidator(_believed_rate)
"""Marks a rate that is held to bounds which the frozen schemas do not state."""

Count = Annotated[int, Field(ge=0, lt=2**63)]
Flag = Annotated[str, StringConstraints(min_length=1, max_length=200)]
Flags = Annotated[tuple[Flag, ...], Field(max_length=64)]
UnitName = Annotated[str, StringConstraints(min_length=1, max_length=32)]
Covariates = Annotated[
    dict[Flag, Finite],
    Field(max_length=64, description="Named with their unit, such as temperature_c."),
]
"""Numbers known beside the measured ones: temperature, load, a simulator's truth."""


def _few_counters(counters: dict[str, int]) -> dict[str, int]:
    if len(counters) > MOST_COUNTERS:
        raise ValueError(
            f"{len(counters)} counters were given. Allowed: up to {MOST_COUNTERS}. Leave some "
            "out."
        )
    longest = max(counters, key=len, default="")
    if len(longest) > LONGEST_COUNTER:
        raise ValueError(
            f"A counter {longest[:40]!r}… of {len(longest)} characters was given. Allowed: up "
            f"to {LONGEST_COUNTER}. Shorten its name."
        )
    return counters


Counters = Annotated[dict[str, Count], AfterValidator(_few_counters)]
"""Counts by name, which a server keeps of each agent."""


def _countable(seconds: float) -> float:
    if seconds > LONGEST_S:
        raise ValueError(
            f"{seconds:.6g} s was given. Allowed: up to {LONGEST_S:.6g} s, which nanoseconds "
            "can be counted for. Correct the clock."
        )
    return seconds


Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_countable)]
"""How long something took [s]."""

RENEWALS = "renewals"
"""Covariate that counts how often the structure was renewed; its rise announces a renewal."""


def _finite_throughout(value: Any) -> Any:
    """Refuse NaN and infinity anywhere inside free-form content, which JSON cannot carry."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} is not a number that JSON has. Leave it out, or give null.")
    if isinstance(value, dict):
        for part in value.values():
            _finite_throughout(part)
    elif isinstance(value, list | tuple):
        for part in value:
            _finite_throughout(part)
    return value


Free = Annotated[dict[str, Any], AfterValidator(_finite_throughout)]
"""Any JSON object; its numbers are finite."""


class Immutable(BaseModel):
    """Immutable model that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Frozen(Immutable):
    """Part of a message or file, whose JSON has names for infinity and NaN."""

    model_config = ConfigDict(ser_json_inf_nan="constants")


class Quantity(Frozen):
    """A measured value and its standard deviation, in the unit its field name ends with."""

    value: Finite
    sd: Sd


class Estimate(KeyedAccess, Frozen):
    """A value, its standard deviation and its 95 % interval."""

    value: Finite
    sd: Sd
    lo: Finite
    hi: Finite

    def __float__(self) -> float:
        return self.value
