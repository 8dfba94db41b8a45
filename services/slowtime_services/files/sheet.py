"""The sheet: columns and stated figures of a file of any kind."""

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Shaped

from .headings.sampling import Facts
from .record import Values
from .times.stamps import Stamps
from .times.zones import Zone

ColumnKind = Literal["number", "stamp", "date", "clock", "word"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One column of a file.

    Parameters
    ----------
    values
        Numbers, with NaN where one is missing; nanoseconds of a stamp; texts of words.
    kind
        What stands in it: numbers, dates with times, dates, times of day, words.
    stamps
        More of a column of stamps.
    missing
        Line, place in it from 1, and text of the first value that is missing or not finite.
    """

    name: str
    unit: str
    values: Shaped[np.ndarray, " time"]
    kind: ColumnKind = "number"
    stamps: Stamps | None = None
    missing: tuple[int, int, str] | None = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sheet:
    """Columns of a file, and figures of its heading.

    Parameters
    ----------
    columns
        In the order of the file, all of one length.
    named
        Whether the file gives the columns names.
    facts
        Figures of the heading.
    tail
        Values of a last row that is shorter than the others.
    format
        Name of a format that fixes the meaning of all this; empty for a table.
    unit
        Unit of all samples, where a heading states it of them together.
    start_ns
        Time of the first sample, where a heading states it.
    start_said
        Words of the heading that state it, where they are not of a format.
    start_zone
        Words of the zone in which that start was read.
    zone
        Time zone that a heading states of all times; None where it states none.
    first_line
        Line of the first row; 0 where rows are not lines.
    """

    columns: tuple[Column, ...]
    named: bool = False
    facts: Facts = dataclasses.field(default_factory=Facts)
    tail: tuple[float, ...] = ()
    format: str = ""
    unit: str = ""
    start_ns: int | None = None
    start_said: str = ""
    start_zone: str = "in UTC"
    zone: Zone | None = None
    aux: Mapping[str, Values] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    first_line: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, each once."""
        found = [column.name for column in self.columns]
        return tuple(
            f"channel_{i}" if not name else name if found.count(name) == 1 else f"{name}_{i}"
            for i, name in enumerate(found)
        )
