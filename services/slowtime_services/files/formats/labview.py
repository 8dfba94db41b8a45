"""LabVIEW measurement files (.lvm): settings, then segments with a heading each.

References
----------
.. [1] National Instruments, "Specification for the LabVIEW Measurement File (.lvm)", 2023.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from slowtime_services.files.delimited.dialect import Dialect
from slowtime_services.files.headings.sampling import Fact, Facts
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.stamps import read_stamps

END = "***End_of_Header***"
SAME_INTERVAL = 0.05
"""Relative difference of intervals that digits of the instants may leave."""
_SEPARATORS = {"tab": "\t", "comma": ","}


def recognise(lines: Sequence[str]) -> bool:
    """Whether lines begin as a LabVIEW measurement does."""
    return bool(lines) and lines[0].lstrip('\ufeff"').startswith("LabVIEW Measurement")


def read(lines: Sequence[str], name: str) -> Sheet:
    """Channels of the first segment, with their units and their interval."""
    ends = [i for i, line in enumerate(lines) if line.strip().startswith(END)]
    if len(ends) < 2:
        raise RecordError(
            f"{name} is a LabVIEW measurement (.lvm) with {len(ends)} of the two lines {END} "
            "that stand above its samples: it is cut short. Save it again, or export it as CSV."
        )
    empty = next((b for a, b in itertools.pairwise(ends) if b == a + 1), None)
    if empty is not None:
        raise RecordError(
            f"Line {empty + 1} of {name} ends a heading that has no line: the file is damaged, "
            "or was edited. Save it again, or export it as CSV."
        )
    settings = _settings(lines[: ends[0]])
    mark = _SEPARATORS.get(settings.get("separator", "tab").casefold(), "\t")
    decimal = "," if settings.get("decimal_separator", ".").strip() == "," else "."
    dialect = Dialect(mark, decimal)
    heading = {
        (fields := line.split(mark))[0].strip().casefold(): [f.strip() for f in fields[1:]]
        for line in lines[ends[0] + 1 : ends[1]]
        if line.strip()
    }
    below = lines[ends[1] + 1 :]
    titles = [field.strip() for field in below[0].split(mark)] if below else []
    # A heading that was cut or edited may lack the line of names: no sample is lost with it.
    unnamed = any(map(dialect.is_number, titles[1:]))
    first = ends[1] + 1 + (not unnamed)
    titles = [] if unnamed else titles
    last = ends[2] - len(heading) - 1 if len(ends) > 2 else len(lines)
    rows = [line.rstrip("\r\n").split(mark) for line in lines[first:last] if line.strip()]
    count = _channels(heading, dialect, max(map(len, rows), default=1), name)
    count = count or max(len(titles) - 2, 1)
    rows = _complete_rows(rows, count, name)
    multiple = settings.get("x_columns", "one").casefold() == "multi"
    places = [2 * i + 1 for i in range(count)] if multiple else list(range(1, count + 1))
    units = [*heading.get("y_unit_label", []), *[""] * count]
    columns = [
        Column(titles[at] if at < len(titles) and titles[at] else f"channel_{i}", units[i],
               _values(rows, at, dialect, name, first + 1))
        for i, at in enumerate(places)
    ]  # fmt: skip
    facts = []
    interval = _first(heading, "delta_x", dialect)
    if interval is not None and interval > 0:
        facts.append(Fact("interval", (interval,), f"Delta_X {interval:g}", ends[0] + 1, 2))
        facts += _of_instants(rows, places[0] - 1, interval, dialect, first + 1)
    samples = _first(heading, "samples", dialect)
    if samples and settings.get("multi_headings", "no").casefold() == "yes":
        facts.append(Fact("count", (samples,), f"Samples {samples:g}", ends[0] + 1))
    notes = (f"{name} holds {len(ends) - 1} segments; only the first is read.",)
    return Sheet(
        columns=tuple(columns),
        named=True,
        facts=Facts(tuple(facts)),
        format="LabVIEW measurement",
        start_ns=_start_ns(heading),
        notes=notes if len(ends) > 2 else (),
        first_line=first + 1,
    )


def _of_instants(
    rows: list[list[str]], at: int, interval: float, dialect: Dialect, line: int
) -> Iterator[Fact]:
    """Yield the interval that the column of instants implies, if it is another."""
    texts = [rows[end][at].strip() if at < len(rows[end]) else "" for end in (0, -1)]
    if len(rows) < 3 or not all(map(dialect.is_number, texts)):
        return
    begin, end = map(dialect.number, texts)
    implied = (end - begin) / (len(rows) - 1)
    if implied > 0 and abs(implied / interval - 1.0) > SAME_INTERVAL:
        yield Fact("interval", (implied,), f"X_Value {begin:g} to {end:g}", line, 2)


def _settings(lines: Sequence[str]) -> dict[str, str]:
    found = {}
    for line in lines:
        key, *values = (
            line.replace(",", "\t", 1).split("\t") if "\t" not in line else line.split("\t")
        )
        found[key.strip().casefold()] = values[0].strip() if values else ""
        if key.strip() == "Decimal_Separator" and line.rstrip().endswith(","):
            found["decimal_separator"] = ","
    return found


def _channels(
    heading: dict[str, list[str]], dialect: Dialect, widest: int, name: str
) -> int | None:
    """Return the number of channels that a heading states; None where it states none."""
    said = (heading.get("channels") or [""])[0]
    if not said:
        return None
    stated = dialect.number(said) if dialect.is_number(said) else math.nan
    if not 1 <= stated <= widest:
        raise RecordError(
            f"{name} states {said[:40]} channels, and its rows have up to {widest} fields: it "
            "is damaged, or was edited. Save it again, or correct the line Channels."
        )
    return int(stated)


def _first(heading: dict[str, list[str]], key: str, dialect: Dialect) -> float | None:
    said = heading.get(key) or [""]
    number = dialect.number(said[0]) if dialect.is_number(said[0]) else math.nan
    return number if math.isfinite(number) else None


def _complete_rows(rows: list[list[str]], count: int, name: str) -> list[list[str]]:
    """Rows without a last one that is cut short, and none of the lines of the next heading."""
    if not rows:
        raise RecordError(
            f"{name} is a LabVIEW measurement without samples. Give another file."
        )
    while len(rows) > 1 and len(rows[-1]) <= min(count, len(rows[0]) - 1):
        rows.pop()
    return rows


def _values(
    rows: list[list[str]], at: int, dialect: Dialect, name: str, first_line: int
) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    values = np.empty(len(rows))
    for i, row in enumerate(rows):
        field = row[at].strip() if at < len(row) else ""
        if dialect.kind(field) not in ("number", "missing"):
            raise RecordError(
                f"Line {first_line + i} of {name} has {field[:40]!r} where a number should be. "
                "Correct or remove that line."
            )
        values[i] = dialect.number(field)
    return values


def _start_ns(heading: dict[str, list[str]]) -> int | None:
    """Start by the heading's own date and time, which name no zone: taken as UTC."""
    dates, times = heading.get("date") or [""], heading.get("time") or [""]
    try:
        stamps = read_stamps([f"{dates[0]} {times[0]}"])
    except ValueError:
        return None
    return int(stamps.ns[0])
