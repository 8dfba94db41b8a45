"""Separation of the name of a column and the unit behind it."""

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from slowtime_services.files.record import NAMES_ACCELERATION
from slowtime_services.files.times.time_axis import is_time_name
from slowtime_services.files.units import VOLTS, unit_of

from .unit_text import is_unit

LONGEST_NAME = 200
"""Characters of the longest field that is looked at as a name with a unit [1]."""
_BRACKETS = (
    re.compile(r"(?P<stem>.*\S)\s*(?P<tail>\[(?P<text>[^\[\]]*)\])"),
    re.compile(r"(?P<stem>.*\S)\s*(?P<tail>\((?P<text>(?:[^()]|\([^()]*\))*)\))"),
    re.compile(r"(?P<stem>.*\S)\s*(?P<tail><(?P<text>[^<>]*)>)"),
)
_SEPARATED = re.compile(r"(?P<stem>.*\S)\s*(?P<tail>(?:,|\s/|\s-|\sin)\s+(?P<text>\S+))")
_STATISTICS = frozenset("min max avg ave mean std rms med tot smp".split())
"""Words in brackets that tell how a column was made, of which ``min`` is a minute, too."""
_COMPASS = frozenset("neswzudv")
"""Letters that are both directions and units, where they stand behind accelerations."""
_TIMES = frozenset("ns ms us in min sec".split())
"""Units that no acceleration has: ``Acc (NS)`` is from north to south."""
_SERIAL_NUMBER = re.compile(r"\(.*\bS/N\b.*\)", re.I)
"""A bracket of HOBOware, which has the serial numbers of logger and sensor."""


class _FieldParts(NamedTuple):
    """A field, cut before its last bracket, or before a separator and a unit."""

    stem: str
    tail: str
    text: str
    unit: str


def names_and_units(
    fields: Sequence[str], below: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of columns from the fields of a heading and the line of units below it.

    A unit below a name precedes one in brackets. Brackets that number columns of one name, or
    name their directions, are part of the name.

    Examples
    --------
    >>> names_and_units(["t [s]", "acc, mg", "a (V)", "a (L)"], ["", "", "", ""])
    (('t', 'acc', 'a (V)', 'a (L)'), ('s', 'mg', '', ''))
    >>> names_and_units(["Acc(1)", "Acc(2)"], ["g", "g"])
    (('Acc(1)', 'Acc(2)'), ('g', 'g'))
    """
    parts = [_parts(field) for field in fields]
    marks = _indices(parts)
    short: list[str] = []
    whole: list[str] = []
    units: list[str] = []
    for place, (field, part, under) in enumerate(zip(fields, parts, below, strict=True)):
        unit, name, shorter = part.unit, part.stem, part.stem
        if unit and place in marks:
            unit = ""
        # A single letter in brackets, beside a unit below, is a direction or a number.
        if unit and is_unit(under) and len(unit) == 1 and unit.casefold() != under.casefold():
            unit = ""
        if not unit:
            inner = _parts(part.stem)
            name = shorter = field
            if inner.unit and part.tail:
                unit, name = inner.unit, f"{inner.stem} {part.tail}"
                shorter = inner.stem if _SERIAL_NUMBER.fullmatch(part.tail) else name
        elif unit != part.text:
            name = field
        short.append(_bare(shorter))
        whole.append(_bare(name))
        units.append(under if under and (is_unit(under) or not unit) else unit)
    times = Counter(short)
    names = [s if times[s] == 1 else w for s, w in zip(short, whole, strict=True)]
    return tuple(names), tuple(units)


def has_unit(field: str) -> bool:
    """Whether a name ends in a unit."""
    part = _parts(field)
    return bool(part.unit or (part.tail and _parts(part.stem).unit))


def _bare(name: str) -> str:
    return name.rstrip(" :/,") or name


def _parts(field: str) -> _FieldParts:
    """Split ``"acc [g]"``, ``"acc (g)"``, ``"acc, g"``, ``"acc / g"`` and ``"acc in g"``."""
    if len(field) > LONGEST_NAME:
        return _FieldParts(field, "", "", "")
    for bracket in _BRACKETS:
        if (match := bracket.fullmatch(field)) is not None:
            text, stem = match["text"].strip(), match["stem"]
            dated = is_time_name(stem) and match["tail"].startswith("[")
            unit = text if dated or _states_unit(stem, text) else _first_unit(text)
            return _FieldParts(stem, match["tail"], text, unit)
    match = _SEPARATED.fullmatch(field)
    if match is not None and _states_unit(match["stem"], match["text"]):
        return _FieldParts(match["stem"], match["tail"], match["text"], match["text"])
    return _FieldParts(field, "", "", "")


def _states_unit(stem: str, text: str) -> bool:
    """Whether a text behind a name is its unit."""
    bare = text.strip("[]() ")
    if not is_unit(text) or (bare.casefold() in _STATISTICS and not is_time_name(stem)):
        return False
    if not NAMES_ACCELERATION.search(stem):
        return True
    if len(bare) > 1:
        return bare.casefold() not in _TIMES
    # An acceleration is in g or volts, but not in newtons, amperes or seconds.
    return bare.casefold() in VOLTS or _is_acceleration(bare)


def _first_unit(text: str) -> str:
    """Find the unit that begins a bracket, as in ``(g, LP 50 Hz)``."""
    first, comma, _ = text.partition(",")
    return first.strip() if comma and _is_acceleration(first) else ""


def _indices(parts: Sequence[_FieldParts]) -> frozenset[int]:
    """Columns whose brackets, or letters behind a separator, are indices or directions."""
    found: set[int] = set()
    exact: dict[str, list[int]] = defaultdict(list)
    alike: dict[str, list[int]] = defaultdict(list)
    for place, part in enumerate(parts):
        if part.tail:
            stem = part.stem.casefold().strip()
            exact[stem].append(place)
            if len(part.text) == 1:
                alike[re.sub(r"\d+", "#", stem)].append(place)
    for places in (*exact.values(), *alike.values()):
        texts = [parts[place].text.casefold() for place in places]
        if len(set(texts)) < 2:
            continue
        others = sum(not parts[place].unit for place in places)
        letters = all(len(text) == 1 for text in texts)
        compass = _COMPASS.issuperset(texts) and NAMES_ACCELERATION.search(
            parts[places[0]].stem
        )
        if compass or (letters and others) or 2 * others > len(places):
            found.update(place for place in places if not _is_acceleration(parts[place].unit))
    return frozenset(found)


def _is_acceleration(unit: str) -> bool:
    known = unit_of(unit)
    return known is not None and known.quantity == "acceleration"
