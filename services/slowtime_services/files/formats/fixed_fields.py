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
    r"(?:\bin|units?\s*=)\s+?\(?(?P<unit>[a-zA-Z]+(?:/[a-zA-Z]+\d?)*(?:\^?2)?)|units?=(?P<other>[\w/^]+)",
    re.I,
)
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
    columns, facts = [], []
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
                f"Line {section.line + 1} of {name} states {section.count} points and "
                f"{len(values)} follow ({section.said[:70]!r}): the file is cut short, or was "
                "changed. Correct the figure if the samples are right."
            )
        label = section.quantity if len(measured) == 1 else f"{section.quantity}_{number}"
        columns.append(Column(label, _unit(section.said), values))
        facts.append(find_facts([section.said], first_line=section.line + 1))
    if len({len(column.values) for column in columns}) > 1:
        raise RecordError(
            f"{name} holds channels of different lengths: "
            f"{', '.join(str(len(c.values)) for c in columns)}. Give one channel in a file."
        )
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
        facts=found,
        format="strong-motion listing",
        notes=notes,
        first_line=measured[0].line + 2,
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
