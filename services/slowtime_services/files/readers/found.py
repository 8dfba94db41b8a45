"""Series that a reader finds in a file, each with its own rate and start."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from slowtime_services.files.record import Values


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One channel of a file.

    Parameters
    ----------
    values
        Numbers, NaN where one is missing; of stamps nanoseconds since 1970-01-01 UTC.
    unit
        As the file writes it; empty where it says none.
    rate_hz
        Samples per second; None where the file does not say.
    start_ns
        Time of the first sample since 1970-01-01 UTC [ns]; None where it does not say.
    stamps
        Whether the values are times.
    """

    name: str
    values: Values
    unit: str = ""
    rate_hz: float | None = None
    start_ns: int | None = None
    stamps: bool = False


class Figure(NamedTuple):
    """A rate that a file states or implies [Hz], and where."""

    rate_hz: float
    text: str


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Series of a file, notes on how they were read, and single numbers."""

    series: Sequence[Series]
    notes: tuple[str, ...] = ()
    singles: Mapping[str, float] = dataclasses.field(default_factory=dict)
    figures: tuple[Figure, ...] = ()
    """What else the file says of its rate; where they contradict it, a person is asked."""

    def to_json(self) -> tuple[dict[str, Any], list[Values]]:
        """Everything but the values as JSON-compatible values; and the values in order."""
        told = {
            "notes": list(self.notes),
            "singles": dict(self.singles),
            "figures": [list(one) for one in self.figures],
            "series": [
                {
                    "name": one.name,
                    "unit": one.unit,
                    "rate_hz": one.rate_hz,
                    "start_ns": one.start_ns,
                    "stamps": one.stamps,
                }
                for one in self.series
            ],
        }
        return told, [one.values for one in self.series]

    @classmethod
    def of_json(cls, told: Mapping[str, Any], arrays: Sequence[Values]) -> "Found":
        """Read the output of `to_json`."""
        series = [
            Series(values=values, **one)
            for one, values in zip(told["series"], arrays, strict=True)
        ]
        figures = tuple(Figure(*one) for one in told["figures"])
        return cls(series, tuple(told["notes"]), told["singles"], figures)
