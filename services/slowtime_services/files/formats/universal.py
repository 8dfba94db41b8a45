"""Universal files of type 58 as text: functions at nodal degrees of freedom.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: number 58, function at nodal DOF".
"""

import math
import re
from collections.abc import Sequence

from slowtime_services.files.headings.sampling import Fact, Facts
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.stamps import read_stamps

from .listing import numbers_of

TIME_RESPONSE = 1
"""Function type of a time response [1]_; others are spectra and the like."""
EVEN = 1
MARK = "slowtime channel"
"""Second line of identification where the first is the name of the channel."""
_MARK = re.compile(r"\s*-1\s*$")
_HEAD_ROWS = 11
"""Records of a dataset before its ordinates [1]_."""


def recognise(lines: Sequence[str]) -> bool:
    """Whether lines begin as a universal file does."""
    said = [line for line in lines[:20] if line.strip()]
    return (
        len(said) > 1
        and bool(_MARK.match(said[0]))
        and bool(re.match(r"\s*\d{1,4}b?\s*", said[1]))
    )


def read(lines: Sequence[str], name: str) -> Sheet:
    """Return a channel for each time response of the file."""
    marks = [i for i, line in enumerate(lines) if _MARK.match(line)]
    columns: list[Column] = []
    intervals: list[float] = []
    starts: list[int | None] = []
    skipped = 0
    for first, last in zip(marks[::2], [*marks[1::2], len(lines)], strict=False):
        kind = lines[first + 1].strip() if first + 1 < len(lines) else ""
        if kind.startswith("58b"):
            raise RecordError(
                f"{name} holds binary datasets (58b). Write it as text from the program that "
                "made it, or read it with pyuff (`pip install pyuff`)."
            )
        if kind != "58":
            continue
        found = _dataset(lines[first + 2 : last], first + 3, name, len(columns))
        if found is None:
            skipped += 1
            continue
        columns.append(found[0])
        intervals.append(found[1])
        starts.append(start_of(lines[first + 4]))
    if not columns:
        raise RecordError(
            f"{name} is a universal file without an evenly spaced time response in a dataset "
            f"58 ({skipped} others). Export time histories, not spectra."
        )
    if len({len(column.values) for column in columns}) > 1 or max(intervals) > 1.0001 * min(
        intervals
    ):
        raise RecordError(
            f"{name} holds time responses of different lengths or intervals: "
            + ", ".join(
                f"{c.name} {len(c.values)} × {i:g} s"
                for c, i in zip(columns, intervals, strict=True)
            )[:300]
            + ". Give those of one measurement in a file of their own."
        )
    fact = Fact(
        "interval", (intervals[0],), f"abscissa increment {intervals[0]:g}", marks[0] + 1, 2
    )
    notes = (f"{skipped} datasets that are no time responses were left out.",) * bool(skipped)
    return Sheet(
        columns=tuple(columns),
        named=True,
        facts=Facts((fact,)),
        format="universal file, dataset 58",
        start_ns=starts[0] if len(set(starts)) == 1 else None,
        notes=notes,
        first_line=marks[0] + 1,
    )


def start_of(text: str) -> int | None:
    """Read the date and time of the third line of identification [ns since 1970]."""
    try:
        stamps = read_stamps([text.strip()])
    except ValueError:
        return None
    return int(stamps.ns[0]) if stamps.dated and not stamps.ambiguous else None


def _dataset(
    lines: Sequence[str], first_line: int, name: str, number: int
) -> tuple[Column, float] | None:
    """One dataset's channel and interval; None where it is no time response."""
    try:
        function = lines[5].split()
        form = lines[6].split()
        ordinate_type, count, spacing = int(form[0]), int(form[1]), int(form[2])
        interval = float(form[4])
        what = int(function[0])
    except (IndexError, ValueError):
        raise RecordError(
            f"The dataset at line {first_line} of {name} has no heading of a function at a "
            "nodal degree of freedom. Export it again."
        ) from None
    if what not in (0, TIME_RESPONSE) or ordinate_type in (5, 6) or spacing != EVEN:
        return None
    values = numbers_of(
        lines[_HEAD_ROWS:], first_line + _HEAD_ROWS, name, _width(lines, ordinate_type)
    )
    if len(values) != count or not 0 < interval < math.inf:
        raise RecordError(
            f"The dataset at line {first_line} of {name} states {count} values {interval:g} s "
            f"apart and has {len(values)}: it is cut short, or was changed. Export it again."
        )
    named = lines[1].strip() == MARK
    name = lines[0].strip() if named else _channel(function, number)
    return Column(name, _unit(lines[8]), values), interval


def _width(lines: Sequence[str], ordinate_type: int) -> int | None:
    """Width of a number where they touch: 13 of single, 20 of double precision [1]_."""
    first = lines[_HEAD_ROWS].rstrip() if len(lines) > _HEAD_ROWS else ""
    width = 13 if ordinate_type == 2 else 20
    return (
        width
        if first and len(first) % width == 0 and len(first.split()) != len(first) // width
        else None
    )


def _channel(function: Sequence[str], number: int) -> str:
    # Response entity name, node and direction follow four numbers of the function [1]_.
    try:
        node, direction = int(function[5]), int(function[6])
    except (IndexError, ValueError):
        return f"response_{number}"
    axis = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}.get(
        direction, str(direction)
    )
    return f"node {node} {axis}"


def _unit(line: str) -> str:
    """Return the unit of the ordinate: the last word of its axis, if it has one."""
    words = line.split()
    return words[-1] if len(words) >= 6 and words[-1].upper() != "NONE" else ""
