"""Limits, alarms and thresholds of a twin, and the settings of its forecast."""

from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from slowtime_schemas.quantities import Immutable, Plain

Positive = Annotated[float, Field(gt=0, lt=1e300, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
_OF_CHANGES = (
    "stiffness_change or mass_change; of a twin of elements, one of its parameters, or "
    "`elements` for each of them."
)
Quantity = Annotated[
    str,
    Field(
        min_length=1,
        max_length=80,
        examples=["stiffness_change", "elements", "storey2"],
        description=_OF_CHANGES,
    ),
    Plain,
]


_SHOWN = {
    "frequency_hz": ("Natural frequency", "Hz", 1.0),
    "damping_ratio": ("Damping ratio", "%", 100.0),
    "stiffness_change": ("Stiffness change", "%", 100.0),
    "mass_change": ("Mass change", "%", 100.0),
}


def shown(quantity: str) -> tuple[str, str, float]:
    """Return the name, display unit and display factor of a quantity.

    Examples
    --------
    >>> shown("mass_change")
    ('Mass change', '%', 100.0)
    """
    return _SHOWN.get(quantity, (f"Change of {quantity}", "%", 100.0))


def signed(number: float) -> str:
    """Write a number for a person: four digits, and a minus sign as the page has it.

    Returns
    -------
    The text.

    Examples
    --------
    >>> signed(-3.14159)
    '−3.142'
    """
    return f"{number:.4g}".replace("-", "−")


class Limit(NamedTuple):
    """A value that a change may reach.

    Parameters
    ----------
    quantity
        A change, or a parameter of a twin of elements.
    at
        The value [1].
    toward
        The side that is asked for; None for the one on which the quantity is not now.
    """

    quantity: str
    at: float
    toward: Literal["below", "above"] | None = None


class Alarm(Immutable):
    """A limit to be warned of, once it is passed with the certainty asked for."""

    quantity: Annotated[
        Quantity, Field(description=f"frequency_hz or damping_ratio; {_OF_CHANGES}")
    ]
    below: Number | None = None
    above: Number | None = None
    certainty: Annotated[float, Field(ge=0.5, lt=1)] = 0.975

    @model_validator(mode="after")
    def _has_one_limit(self) -> Self:
        if (self.below is None) == (self.above is None):
            raise ValueError(
                f"An alarm on {self.quantity} has one limit. Give below or above, not both; "
                "two limits are two alarms."
            )
        return self

    @property
    def limit(self) -> tuple[Literal["below", "above"], float]:
        """Side on which the alarm is raised, and its limit."""
        if self.below is not None:
            return "below", self.below
        assert self.above is not None
        return "above", self.above


class Threshold(Immutable):
    """A value of a change, and the question when it will be reached."""

    quantity: Quantity
    at: Annotated[float, Field(ge=-1.0, le=1e6, examples=[-0.2])]


class Forecasting(Immutable):
    """Settings of the forecast.

    The limits of its alarms are thresholds as well.
    """

    thresholds: Annotated[tuple[Threshold, ...], Field(max_length=16)] = ()
    process: Annotated[
        Literal["evidence", "smooth", "repeating"],
        Field(
            description="Whether its past repeats itself: as the readings say, or as somebody "
            "knows: never, or always, where a period is found."
        ),
    ] = "evidence"
    horizon: Annotated[
        Positive | None,
        Field(
            description="How far ahead, in slow time, where a request does not say; by default "
            "that of a decision in slow time, else as long as the past."
        ),
    ] = None
    readings_between_false_alarms: Annotated[
        float | None,
        Field(
            ge=100,
            le=1e12,
            description="Mean, at least, of saying that the model has changed; null to say "
            "nothing of it.",
        ),
    ] = 1e4
