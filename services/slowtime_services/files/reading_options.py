"""What a person says of a file, and what to do with missing values."""

from collections.abc import Sequence
from typing import NamedTuple

from .record import RecordError
from .times.time_units import UNITS

SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e9
"""Sampling rates that a person may give; beyond these they are slips of the pen."""
ALL = "all"


class Said(NamedTuple):
    """What a person says of a file."""

    rate_hz: float | None
    channels: Sequence[str] | None
    time_column: str | None
    time_unit: str | None
    wrapped: bool | None
    keep: tuple[str, ...]


class Missing(NamedTuple):
    """What to do with values that are missing."""

    keep: bool
    skip: bool


def refuse_slips(rate_hz: float | None, time_unit: str | None) -> None:
    """Refuse a rate or a unit that nobody can mean."""
    if rate_hz is not None and not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise RecordError(
            f"{rate_hz:g} is not a sampling rate. Give samples per second, from {SLOWEST_HZ:g} "
            f"to {FASTEST_HZ:g}."
        )
    if time_unit is not None and time_unit not in UNITS:
        raise RecordError(f"{time_unit!r} is no unit of time. Allowed: {', '.join(UNITS)}.")
