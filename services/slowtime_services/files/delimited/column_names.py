"""Names and units of columns, from the lines above the rows."""

import re
from collections.abc import Sequence

from slowtime_services.files.record import looks_like_unit
from slowtime_services.files.times.time_axis import is_time_name

from .dialect import Dialect

MOST_ROWS = 5
"""Lines of a heading that are looked at: names, units, kind of processing, and a rule."""
MOST_BETWEEN = 3
"""Lines between heading and rows that are neither, such as ranges or offsets."""
_MARKS = "#%!;*/ "
_PROCESSING = frozenset(
    "smp avg max min std tot med wvc ts rn ac dc iepe double float single int int16 int32 "
    "real text string datetime numeric".split()
)
"""Words of a line below the names that tells how a column was made, or of which type it is."""
_CHANNEL_WORD = re.compile(
    r"acc|(?<![a-z])[agvwxyz][\s_]?[xyz]?\d*(?![a-z])|chan|(?<![a-z])ch\W?\d|sens|geo|disp|vel|"
    r"force|strain|load|temp|volt|gyr|mag|ais?\d|signal|value|wert|mess|respon|count|index|sample",
    re.I,
)
_SENTENCE = frozenset("of in the by for from and is at to with on was".split())
"""Words that stand in sentences, and hardly alone as a name."""
_RULE = re.compile(r"[\s\-=_+|*~.;,]+$")
_SETTING = re.compile(r"\w\s*[:=]\s*\w")
"""A key and its value, which are no name of a column that is alone."""
_X_AXIS = re.compile(r"x[\s_-]*axis", re.I)
_SECTION = re.compile(r"\s*(?:\*+\s*[A-Za-z]+|\[[A-Za-z ]+\])\s*$")
"""A line that opens a part of a heading, such as ``*UNIT`` or ``[Data]``, and names nothing."""
_KEY_OF_NAMES = frozenset(
    "header headers heading columns fields channels names labels spalten kanäle colonnes "
    "voies columnas canales".split()
)
"""Words before the names of columns that are no name themselves: ``Headers, time, Ax``."""


def read_heading(
    preamble: Sequence[str], dialect: Dialect, width: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns; no names where no line above the rows is a heading.

    Parameters
    ----------
    preamble
        Lines above the first row.
    width
        Number of columns.
    """
    rows = _rows_above(preamble, dialect, width)
    if not rows and width > 1:
        # The number of a row, or the time beside a date, often has no name of its own.
        fewer = _rows_above(preamble, dialect, width - 1, most_between=0)
        rows = [["", *row] for row in fewer] if any(map(_is_heading, fewer[:2])) else []
    units: tuple[str, ...] = ("",) * width
    while rows and _is_beside_names(rows[0]) and (len(rows) > 1 or _are_only_units(rows[0])):
        if sum(map(looks_like_unit, rows[0])):
            units = tuple(_bare_unit(field) for field in rows[0])
        rows = rows[1:]
    if rows and width == 1 and _SETTING.search(rows[0][0]):
        return (), units
    if not rows or (len(rows) > 1 and not _is_heading(rows[0]) and _are_settings(rows)):
        return (), units
    named = [_name_and_unit(field) for field in rows[0]]
    names = tuple(name for name, _ in named)
    return names, tuple(unit or below for (_, unit), below in zip(named, units, strict=True))


def _rows_above(
    preamble: Sequence[str], dialect: Dialect, width: int, most_between: int = MOST_BETWEEN
) -> list[list[str]]:
    """Lines of as many words as there are columns, from the last line upwards."""
    rows: list[list[str]] = []
    between = 0
    for line in reversed(preamble):
        if not line.strip() or _RULE.match(line.strip().lstrip("#%!;*/")):
            continue
        if width > 1 and _SECTION.match(line):
            continue
        fields = _fields(line, dialect, width)
        if fields is not None and not rows and between and not _is_heading(fields):
            fields = None  # words a few lines above the rows are a heading only if they look so
        if fields is not None:
            rows.append(fields)
        elif rows or between == most_between or _is_setting(line, dialect, width):
            break
        between += fields is None
        if len(rows) == MOST_ROWS:
            break
    return rows


def _fields(line: str, dialect: Dialect, width: int) -> list[str] | None:
    """Fields of a line of words; None where it does not have one for each column."""
    # A delimiter in front is an empty field, as above a clock without a unit, and no mark.
    marks = _MARKS.replace(dialect.delimiter, "") if dialect.delimiter else _MARKS
    for text in dict.fromkeys((line.lstrip(marks), line.lstrip(_MARKS), line.strip("\r\n"))):
        for split in _ways_to_split(text, dialect):
            if (
                sum(map(bool, split)) > width
                and split[0].strip(":").casefold() in _KEY_OF_NAMES
            ):
                split = split[1:]
            fields = _fitted(split, width, spare=dialect.delimiter is not None)
            if fields is None or any(field.endswith(":") for field in fields[:-1]):
                continue
            if dialect.delimiter is None and _SENTENCE.intersection(map(str.casefold, fields)):
                continue
            numbers = sum(map(_is_numeric, split))
            timed = is_time_name(fields[0]) or _X_AXIS.fullmatch(fields[0])
            if numbers and not (timed and _counts(fields[1:])):
                continue
            return fields
    return None


def _is_numeric(field: str) -> bool:
    """Whether a field is a number, several, or one with a unit behind."""
    valued = re.match(r"[+-]?\d[\d.,]*\s*(?=\D)", field)
    if valued is not None and looks_like_unit(field[valued.end() :]):
        return True
    return bool(re.fullmatch(r"[\d\s.,:+-]*\d[\d\s.,:+-]*(?:[eE][+-]?\d+)?", field))


def _ways_to_split(text: str, dialect: Dialect) -> list[list[str]]:
    ways = [dialect.split(text)]
    if dialect.delimiter is None:
        # Names may hold blanks where rows are parted by blanks.
        ways += [[part.strip() for part in re.split(form, text.strip())]
                 for form in (r"\t+", r"\s{2,}", r"\s*[,;|]\s*")]  # fmt: skip
    else:
        # A delimiter at the end may stand for a column without a name.
        ways.append(
            [field.strip().strip("\"'").strip() for field in text.split(dialect.delimiter)]
        )
        other = [
            mark for mark in ("\t", ";", ",") if mark != dialect.delimiter and mark in text
        ]
        ways += [[field.strip().strip("\"'").strip() for field in text.split(mark)]
                 for mark in other]  # fmt: skip
    return ways


def _fitted(fields: list[str], width: int, *, spare: bool) -> list[str] | None:
    """Fields for `width` columns; with `spare`, one beyond is of a column without rows."""
    if len(fields) < width or not any(fields):
        return None
    if sum(map(bool, fields[:width])) * 2 < width:
        return None
    # More than one word too many, and the line is a sentence.
    if len(fields) > width + spare and any(fields[width + spare :]):
        return None
    return fields[:width]


def _counts(fields: Sequence[str]) -> bool:
    return list(fields) in (
        [str(i) for i in range(1, len(fields) + 1)],
        [str(i) for i in range(len(fields))],
    )


def _is_setting(line: str, dialect: Dialect, width: int) -> bool:
    """Whether a line is a key and its values, above which there are settings, not names."""
    fields = dialect.split(line.lstrip(_MARKS))
    words = [not _is_numeric(field) for field in fields]
    return len(fields) == width > 1 and words[0] and not all(words)


def _is_beside_names(fields: Sequence[str]) -> bool:
    """Whether a line of units, or of kinds of processing, stands below the names."""
    said = [field for field in fields if field]
    hits = sum(looks_like_unit(f) or f.strip("[]()").casefold() in _PROCESSING for f in said)
    # Channels may be called x, y, z, a or v, but hardly all of them like units.
    first_is_name = bool(said) and is_time_name(said[0]) and not looks_like_unit(said[0])
    return bool(said) and hits * 2 >= len(said) and not first_is_name


def _are_only_units(fields: Sequence[str]) -> bool:
    """Whether words that stand alone above the rows are units and could not be names."""
    return all(looks_like_unit(field) for field in fields if field) and any(
        re.search(r"[\[\]/^²]", field) for field in fields
    )


def _is_heading(fields: Sequence[str]) -> bool:
    """Whether there is positive evidence that the words are names of columns."""
    bracketed = sum(bool(_name_and_unit(field)[1]) for field in fields)
    named = sum(bool(_CHANNEL_WORD.search(field)) for field in fields)
    timed = sum(map(is_time_name, fields))
    return bool(bracketed) or is_time_name(fields[0]) or (named + timed) * 2 >= len(fields)


def _are_settings(rows: Sequence[Sequence[str]]) -> bool:
    """Whether lines one above the other are settings, a key and its value each."""
    if len(rows[0]) == 1:
        return bool(re.search(r"[:=]", rows[0][0]))
    return len(rows) > 2 and len(rows[0]) <= 3


def _name_and_unit(field: str) -> tuple[str, str]:
    """Split ``"acc [m/s^2]"``, ``"acc (g)"``, ``"acc, g"`` and ``"acc / g"``."""
    match = re.match(r"(.*\S)\s*[\[(]([^\])]*)[\])]$", field)
    if match and (field.endswith("]") or looks_like_unit(match.group(2))):
        return match.group(1), match.group(2)
    match = re.match(r"(.*\S)\s*(?:,|\s/|\s-)\s+(\S+)$", field)
    if match and looks_like_unit(match.group(2)):
        return match.group(1), match.group(2)
    return field, ""


def _bare_unit(field: str) -> str:
    bare = field.strip()
    for opening, closing in ("[]", "()", "<>"):
        if bare.startswith(opening) and bare.endswith(closing):
            bare = bare[1:-1]
    return "" if bare.casefold() in _PROCESSING - {"ts"} or bare in ("-", "TS") else bare
