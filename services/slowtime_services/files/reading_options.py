"""Options of reading a file that a user gives, and the policy for missing values."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from .record import RecordError
from .times.time_units import UNITS

MIN_RATE_HZ, MAX_RATE_HZ = 1e-6, 1e9
"""Sampling rates that a user may give [Hz]; beyond them a rate is a typing error."""
ALL = "all"
Repeated = Literal["drop", "keep"]
"""What is done with rows that repeat the one before."""


class ReadingOptions(NamedTuple):
    """Options that overrule what a file states: rate [Hz], channels, clock, repeated rows."""

    rate_hz: float | None
    channels: Sequence[str] | None
    time_column: str | None
    time_unit: str | None
    wrapped: bool | None
    keep: tuple[str, ...]
    repeated: Repeated | None = None


class MissingPolicy(NamedTuple):
    """Policy for missing values: keep them as NaN, or leave the rows out as gaps."""

    keep: bool
    skip: bool


def refuse_implausible_options(rate_hz: float | None, time_unit: str | None) -> None:
    """Refuse an implausible sampling rate and an unknown unit of time.

    Raises
    ------
    RecordError
        Where the rate [Hz] is out of range, or the unit is not one of `UNITS`.
    """
    if rate_hz is not None and not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise RecordError(
            f"{rate_hz:g} is not a sampling rate. Give samples per second, from "
            f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}."
        )
    if time_unit is not None and time_unit not in UNITS:
        raise RecordError(
            f"{time_unit!r} is not a valid unit of time. Allowed: {', '.join(UNITS)}."
        )
