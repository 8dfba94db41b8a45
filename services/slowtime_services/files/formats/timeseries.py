"""Time series listings of seismology: SLIST and TSPAIR, as ObsPy and web services write them.

References
----------
.. [1] EarthScope, "timeseries web service: ASCII output",
   https://service.iris.edu/irisws/timeseries/1/
"""

import re
from collections.abc import Sequence

import numpy as np

from slowtime_services.files.headings.sampling import Fact, Facts
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.stamps import read_stamps
from slowtime_services.files.times.time_units import FASTEST_HZ, SLOWEST_HZ

from .listing import numbers_of

_HEADING = re.compile(
    r"TIMESERIES\s+(?P<id>[^,]+),\s*(?P<n>\d+)\s+samples?,\s*(?P<rate>\d+\.?\d*(?:[eE][+-]?\d{1,2})?)\s+sps,\s*"
    r"(?P<start>[^,]+),\s*(?P<kind>SLIST|TSPAIR)\s*,\s*(?P<type>\w+)\s*(?:,\s*(?P<unit>.*))?$",
    re.I,
)
_PAIR = re.compile(r"(?P<stamp>\S+)\s*[\s,]\s*(?P<value>\S+)\s*$")


def recognise(lines: Sequence[str]) -> bool:
    """Whether the first line is the heading of such a listing."""
    return bool(lines) and _HEADING.match(lines[0].lstrip("\ufeff# ").strip()) is not None


def read(lines: Sequence[str], name: str) -> Sheet:
    """One channel; segments of it that follow are held against its clock as gaps."""
    starts = [
        i for i, line in enumerate(lines) if line.lstrip("\ufeff# ").startswith("TIMESERIES")
    ]
    parts, begins, heads, times = [], [], [], []
    facts: list[Fact] = []
    for first, last in zip(starts, [*starts[1:], len(lines)], strict=True):
        heading = _HEADING.match(lines[first].lstrip("\ufeff# ").strip())
        if heading is None:
            raise RecordError(
                f"Line {first + 1} of {name} begins like the heading of a listing but is "
                "not one: "
                f"{lines[first][:80]!r}. Correct it, or cut the file there."
            )
        body = [line for line in lines[first + 1 : last] if line.strip()]
        if heading["kind"].upper() == "TSPAIR":
            pairs = [_pair(line, first + 2 + i, name) for i, line in enumerate(body)]
            times += [stamp for stamp, _ in pairs]
            body = [value for _, value in pairs]
        values = numbers_of(body, first + 2, name)
        facts.append(
            Fact("count", (float(heading["n"]),), f"{heading['n']} samples", first + 1)
        )
        parts.append(values)
        begins.append(_start_ns(heading["start"]))
        heads.append(heading)
    if len({(h["id"].strip(), float(h["rate"])) for h in heads}) > 1:
        raise RecordError(
            f"{name} lists several series: "
            f"{', '.join(sorted({h['id'].strip() for h in heads}))}. "
            "Give one of them in a file of its own."
        )
    rate = float(heads[0]["rate"])
    if not SLOWEST_HZ <= rate <= FASTEST_HZ:
        raise RecordError(
            f"Line {starts[0] + 1} of {name} states {heads[0]['rate']} samples per "
            "second. Correct the line."
        )
    if len(parts) > 1:
        facts = []  # each is of one segment
    facts.append(Fact("rate", (rate,), f"{heads[0]['rate']} sps", starts[0] + 1, 2))
    columns = [Column(heads[0]["id"].strip(), _unit(heads[0]["unit"]), np.concatenate(parts))]
    if times:
        columns.insert(0, _stamped(times, name))
    elif len(parts) > 1:
        columns.insert(0, Column("time_ns", "ns", _instants(parts, begins, rate, name)))
    return Sheet(
        columns=tuple(columns),
        named=True,
        facts=Facts(tuple(facts)),
        format=f"{heads[0]['kind'].upper()} listing",
        start_ns=begins[0],
        first_line=starts[0] + 2,
    )


def _pair(line: str, number: int, name: str) -> tuple[str, str]:
    pair = _PAIR.match(line)
    if pair is None:
        raise RecordError(
            f"Line {number} of {name} is not a valid pair of time and value: {line[:60]!r}."
        )
    return pair["stamp"].rstrip(","), pair["value"]


def _stamped(times: list[str], name: str) -> Column:
    try:
        stamps = read_stamps(times)
    except ValueError as error:
        raise RecordError(f"{name}, sample {error.args[-1]}: {error.args[0]}.") from error
    return Column("time", "", stamps.ns, "stamp", stamps)


def _start_ns(text: str) -> int | None:
    try:
        return int(read_stamps([text.strip()]).ns[0])
    except ValueError:
        return None


def _unit(text: str | None) -> str:
    said = (text or "").strip()
    return "" if said.casefold() in ("counts", "count") else said


def _instants(
    parts: "list[np.ndarray[tuple[int], np.dtype[np.float64]]]",
    begins: list[int | None],
    rate: float,
    name: str,
) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Return the times of all samples, from the start of each segment."""
    times = []
    for values, begin in zip(parts, begins, strict=True):
        if begin is None:
            raise RecordError(
                f"{name} has a segment without a start. Give one series at a time."
            )
        times.append(begin + np.round(np.arange(len(values)) * (1e9 / rate)).astype(np.int64))
    return np.concatenate(times)
