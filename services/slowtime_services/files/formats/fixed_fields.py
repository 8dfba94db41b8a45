"""Listings with a Fortran format in their heading: strong-motion files (V1, V2) and the like.

A line such as ``2000 points of accel data equally spaced at .010 sec, in cm/sec2. (8f10.5)``
says how many numbers follow, how wide each is, how far apart they are and what unit they have.

References
----------
.. [1] California Strong Motion Instrumentation Program, "Standard tape format for CSMIP
   strong-motion data", Report OSMS 85-03, 1985.
.. [2] COSMOS, "Strong motion data format", version 1.20, 2001.
"""

import dataclasses
import re
from collections.abc import Iterator, Sequence

from slowtime_services.files.headings.sampling import Facts, find_facts
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Column, Sheet

from .listing import numbers_of

_FORMAT = re.compile(
    r"\(?\s*(?P<n>\d{1,3})?\s*[fFeEgGdDiI](?P<width>\d{1,2})(?:\.\d{1,2})?\s*\)"
)
_COUNT = re.compile(
    r"^\s*(?P<n>\d{2,9})\s+(?:points|pts|values|data\s+points|(?:\w+\s+){0,3}(?:pts|points))",
    re.I,
)
_UNIT = re.compile(
    r"(?:\bin(?:\s+units\s+of)?|units?\s*=)\s+?\(?(?P<unit>[a-zA-Z]+(?:/[a-zA-Z]+\d?)*(?:\^?2)?)|units?=(?P<other>[\w/^]+)",
    re.I,
)
_BEGUN = (
    re.compile(r"(?:start|begin(?:ning)?)\s*time\s*[:=]?\s*(?P<when>\S.*)", re.I),
    re.compile(r"(?:rcrd|record)\s+of\s+(?P<when>\S.*)", re.I),
)
"""Words before the time at which a channel begins, the surest first."""
_QUANTITIES = (("accel", "acceleration"), ("veloc", "velocity"), ("displ", "displacement"))
_END = re.compile(r"/&|end\s+of\s+data|^\s*$", re.I)


@dataclasses.dataclass(frozen=True, slots=True)
class _Section:
    line: int
    count: int
    width: int
    said: str

    @property
    def quantity(self) -> str:
        text = self.said.casefold()
        return next((long for short, long in _QUANTITIES if short in text), "channel")


def recognise(lines: Sequence[str]) -> bool:
    """Whether a heading states a count of points and a Fortran format in one line."""
    return next(_sections(lines), None) is not None


def _sections(lines: Sequence[str]) -> Iterator[_Section]:
    for index, line in enumerate(lines):
        if len(line) > 200 or "(" not in line:
            continue
        form, count = _FORMAT.search(line), _COUNT.match(line)
        if form is not None and count is not None:
            yield _Section(index, int(count["n"]), int(form["width"]), line.strip())


def read(lines: Sequence[str], name: str) -> Sheet:
    """Return the acceleration of the file; series computed from it are left out."""
    sections = list(_sections(lines))
    measured = [s for s in sections if s.quantity in ("acceleration", "channel")] or sections[
        :1
    ]
    columns, facts, starts, heading = [], [], [], 0
    for number, section in enumerate(measured):
        rest = lines[section.line + 1 :]
        rows = -(-section.count // max(_per_line(rest, section.width), 1))
        body = []
        for line in rest[:rows]:
            if _END.search(line):
                break
            body.append(line)
        values = numbers_of(body, section.line + 2, name, section.width)
        if len(values) != section.count:
            raise RecordError(
                f"Line {section.line + 1} of {name} ({section.said[:70]!r}) states "
                f"{section.count} points and {len(values)} follow: the file is cut short, or "
                "was edited. Get the original again, or correct the number of points in that "
                "line if the samples are complete."
            )
        starts.append(_start(lines[heading : section.line]))
        heading = section.line + 1 + len(body)
        label = section.quantity if len(measured) == 1 else f"{section.quantity}_{number}"
        columns.append(Column(label, _unit(section.said), values))
        facts.append(find_facts([section.said], first_line=section.line + 1))
    columns, cut = _of_one_length(columns, starts, facts, name)
    found = facts[0]
    if not found.of("interval") and not found.of("rate"):
        found = Facts((*found.found, *find_facts(lines[: measured[0].line]).found))
    left = sorted({s.quantity for s in sections if s not in measured})
    notes = (f"Left out, being computed from the acceleration: {', '.join(left)}.",) * bool(
        left
    )
    return Sheet(
        columns=tuple(columns),
        named=True,
        facts=found.of_any_length if cut else found,
        format="strong-motion listing",
        notes=(*notes, *cut),
        first_line=measured[0].line + 2,
    )


def _start(heading: Sequence[str]) -> str:
    """Words that state when a channel begins, the surest of them; "" where there are none."""
    found = (words.search(line) for words in _BEGUN for line in heading)
    return next((" ".join(match["when"].split()) for match in found if match), "")


def _of_one_length(
    columns: list[Column], starts: Sequence[str], facts: Sequence[Facts], name: str
) -> tuple[list[Column], tuple[str, ...]]:
    """Cut channels that begin together to the shortest.

    Raises
    ------
    RecordError
        Where channels of different lengths are not known to begin together.
    """
    counts = [len(column.values) for column in columns]
    if len(set(counts)) == 1:
        return columns, ()
    told = ", ".join(map(str, counts))
    paces = {
        tuple(f.values for kind in ("interval", "rate") for f in fact.of(kind))
        for fact in facts
    }
    if len(set(starts)) > 1 or not starts[0] or len(paces) > 1:
        known = "; ".join(start or "not stated" for start in starts)
        raise RecordError(
            f"{name} holds channels of different lengths, {told} points, that are not known to "
            f"begin together at one rate (starts: {known}). Give one channel in a file."
        )
    least = min(counts)
    columns = [dataclasses.replace(c, values=c.values[:least]) for c in columns]
    return columns, (
        f"Channels of {told} points begin together ({starts[0]}): all were cut to {least}.",
    )


def _per_line(rows: Sequence[str], width: int) -> int:
    first = rows[0].rstrip() if rows else ""
    return -(-len(first) // width)


def _unit(said: str) -> str:
    match = _UNIT.search(said)
    if match is None:
        return ""
    unit = (match["unit"] or match["other"] or "").rstrip(".").casefold()
    known = {"cm/sec2": "cm/s^2", "cm/sec/sec": "cm/s^2", "cm/s/s": "cm/s^2", "cm/s2": "cm/s^2",
             "cm/sec": "cm/s", "m/sec2": "m/s^2", "gal": "gal", "gals": "gal", "g": "g",
             "g/10": "g/10", "mg": "mg"}  # fmt: skip
    return known.get(unit, unit if "/" in unit else "")
