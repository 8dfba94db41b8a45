"""The smallest nouns: names, quantities with their standard deviation, estimates with an interval."""

from typing import Annotated

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeFloat,
    StringConstraints,
)

Name = Annotated[
    str,
    StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$"),
    Field(
        description="Lower-case letters, digits, '-' and '_', at most 63; it becomes part of a key."
    ),
]
"""A site or an asset."""

BootId = Annotated[
    str,
    StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._-]{0,63}$"),
    Field(description="One run of one edge agent; sequence numbers start again with each."),
]

Nanoseconds = Annotated[int, Field(ge=0, lt=2**63, description="Since 1970-01-01 UTC [ns].")]
Sequence = Annotated[
    int, Field(ge=0, lt=2**63, description="Counts a stream's messages within a boot.")
]
Finite = FiniteFloat
Sd = Annotated[NonNegativeFloat, Field(allow_inf_nan=False, description="Standard deviation.")]


class Frozen(BaseModel):
    """Immutable, and refusing keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")


class Quantity(Frozen):
    """A measured value and its standard deviation, in the unit its field name ends with."""

    value: Finite
    sd: Sd


class Estimate(Frozen):
    """A value, its standard deviation and its 95 % interval."""

    value: Finite
    sd: Sd
    lo: Finite
    hi: Finite
