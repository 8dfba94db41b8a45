"""Names and units of columns, from the lines above the rows."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slowtime_services.files.record import looks_like_unit
from slowtime_services.files.times.time_axis import is_time_name
from slowtime_services.files.units import unit_of

from .dialect import ColumnLayout, Dialect
from .names_and_units import has_unit, names_and_units

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
_KEY_WORDS = frozenset(
    "name label location position sensor channel signal kanal messstelle ort bezeichnung voie "
    "nom nombre canal nome nummer number no id messpunkt punkt point stelle kanalname "
    "signalname channelname sensorname".split()
)
"""Words of the first field of a line that names the columns beside it: ``Name;Roof;Base``."""
_UNIT_KEYS = frozenset(
    "unit units einheit einheiten unité unités unidad unidades unità".split()
)
_IN_BRACKETS = re.compile(r"\([^()\"]*\)|\[[^\[\]\"]*\]")
_HIDDEN = "\x1f"
"""In the place of a delimiter in brackets, which parts no names."""
EVIDENCE_ROWS = 60
"""Rows that tell whether the first or the last column is the one without a name [1]."""


class Heading(NamedTuple):
    """Names and units of columns, none where no line is a heading, and notes."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    notes: tuple[str, ...] = ()


class _Form(NamedTuple):
    """What a line of words has to match: the dialect and the number of columns.

    Parameters
    ----------
    keyed
        Whether lines begin with a key, such as ``Unit``, before a word for each column.
    transposed
        Whether the key stands above the first column, and settings are no end of a heading.
    running
        Whether the first column is a time or a counter, whose name a key is not.
    closed
        Whether rows end without a delimiter, so that a last name may be of no column.
    """

    dialect: Dialect
    width: int
    keyed: bool = False
    transposed: bool = False
    running: bool = False
    closed: bool = True


def read_heading(
    preamble: Sequence[str], layout: ColumnLayout, body: Sequence[str] = ()
) -> Heading:
    """Names and units of the columns; no names where no line above the rows is a heading.

    Parameters
    ----------
    preamble
        Lines above the first row.
    body
        Rows, the first of which tell which column has no name where there is one name less.
    """
    dialect, width = layout.dialect, len(layout.kinds)
    first = [line for line in body[:EVIDENCE_ROWS] if line.strip()]
    keyed = _are_keyed(preamble, layout, first)
    running = layout.kinds[0] not in ("number", "word") or _mostly_rises(
        _steps(layout, first, 0)
    )
    transposed = any(
        len(fields) == width and _is_unit_row(fields)
        for fields in (dialect.split(line) for line in preamble)
    )
    closed = not any(map(dialect.ends_open, first[:3]))
    rows = _rows_above(preamble, _Form(dialect, width, keyed, transposed, running, closed))
    if transposed:
        rows = [["" if _is_key(row[0]) else row[0], *row[1:]] for row in rows]
    notes: tuple[str, ...] = ()
    if not rows and width > 1:
        fewer = _rows_above(preamble, _Form(dialect, width - 1), most_between=0)
        if any(map(_is_heading, fewer[:2])):
            rows, notes = _with_nameless_column(fewer, layout, first)
    units: tuple[str, ...] = ("",) * width
    while rows and _is_beside_names(rows[0]) and (len(rows) > 1 or _are_only_units(rows[0])):
        if any(map(_is_unit_word, rows[0])):
            units = tuple(_bare_unit(field) for field in rows[0])
        rows = rows[1:]
    if rows and width == 1 and _SETTING.search(rows[0][0]):
        return Heading((), units)
    if not rows or (len(rows) > 1 and not _is_heading(rows[0]) and _are_settings(rows)):
        return Heading((), units, _one_too_many(preamble, layout))
    return Heading(*names_and_units(rows[0], units), notes)


def _one_too_many(preamble: Sequence[str], layout: ColumnLayout) -> tuple[str, ...]:
    """Note that the line above the rows has a word more than there are columns."""
    last = next((line for line in reversed(preamble) if line.strip()), "")
    fields = layout.dialect.split(last)
    if len(fields) != len(layout.kinds) + 1 or not all(fields) or any(map(_is_numeric, fields)):
        return ()
    return (
        f"Columns have no names, because the line above them has one word more ({last[:60]!r}) "
        "and may begin with a key. Give the names with --reading columns.",
    )


def _with_nameless_column(
    fewer: Sequence[list[str]], layout: ColumnLayout, body: Sequence[str]
) -> tuple[list[list[str]], tuple[str, ...]]:
    """Put an empty name in front of one name less than there are columns, or behind them.

    The number of a row, or the time beside a date, often has no name of its own. Where the
    first column is as its name says, or is no such column, it is the last that has no name.
    """
    names = next(row for row in fewer[:2] if _is_heading(row))
    if _is_first_nameless(names[0], layout, body):
        return [["", *row] for row in fewer], ()
    said = (
        f"The heading has {len(names)} names for {len(layout.kinds)} columns; the last column "
        "was taken to have none. Give all names with --reading columns if that is wrong."
    )
    return [[*row, ""] for row in fewer], (said,)


def _is_first_nameless(name: str, layout: ColumnLayout, body: Sequence[str]) -> bool:
    """Whether the first of several columns is one that stands before those with names."""
    kinds = layout.kinds
    timed = is_time_name(name)
    if timed and kinds[1] in ("stamp", "clock"):
        return True  # a date or a number beside a time
    if kinds[0] != "number":
        return not timed or _are_digits(layout, body, 1)
    first = _steps(layout, body, 0)
    if timed:
        return bool(len(first) and (first == 1).all() and (_steps(layout, body, 1) > 0).all())
    return len(first) == 0 or _mostly_rises(first) or not first.any()


def _are_digits(layout: ColumnLayout, body: Sequence[str], place: int) -> bool:
    """Whether a column has as many digits in each row, as decimals of a stamp in front have."""
    width = len(layout.kinds)
    fields = [row[place] for line in body if len(row := layout.dialect.split(line)) == width]
    return len({len(one) for one in fields}) == 1 and all(map(str.isdigit, fields))


def _steps(layout: ColumnLayout, body: Sequence[str], place: int) -> Float[np.ndarray, " row"]:
    """Return the steps of a column between the first rows; NaN beside what is no number."""
    dialect, width = layout.dialect, len(layout.kinds)
    fields = [row[place] for line in body if len(row := dialect.split(line)) == width]
    values = [dialect.number(one) if dialect.is_number(one) else np.nan for one in fields]
    return np.diff(np.array(values, dtype=float))


def _mostly_rises(steps: Float[np.ndarray, " row"]) -> bool:
    return bool(len(steps) and (steps > 0).mean() > 0.9)


def _are_keyed(preamble: Sequence[str], layout: ColumnLayout, body: Sequence[str]) -> bool:
    """Whether lines with one field more than there are columns begin with a key.

    The key of one line of settings, such as ``Sample rate;200;200`` or ``Unit;g;g``, tells
    that the line of names above it begins with one, too.
    """
    dialect, width = layout.dialect, len(layout.kinds)
    if dialect.delimiter is None or layout.kinds[0] == "word":
        return False
    for line in preamble:
        fields = dialect.split(line.strip("\r\n"))
        if len(fields) != width + 1 or not all(fields) or _is_numeric(fields[0]):
            continue
        if _is_unit_row(fields):
            return True
        if not is_time_name(fields[0]) and all(map(_is_numeric, fields[1:])):
            return True
        if _is_key(fields[0]) and not _mostly_rises(_steps(layout, body, 0)):
            return True
    return False


def _is_unit_row(fields: Sequence[str]) -> bool:
    """Whether a line is a key such as ``Unit`` and the units of columns."""
    said = [field for field in fields[1:] if field]
    key = fields[0].strip(": ").casefold()
    return key in _UNIT_KEYS and bool(said) and all(map(_is_unit_word, said))


def _is_key(field: str) -> bool:
    """Whether all words of a field tell what the words beside it are, as ``Channel name``."""
    words = re.findall(r"[^\W\d_]+", field.casefold())
    return bool(words) and all(
        word in _KEY_WORDS | _KEY_OF_NAMES | _UNIT_KEYS for word in words
    )


def _rows_above(
    preamble: Sequence[str], form: _Form, most_between: int = MOST_BETWEEN
) -> list[list[str]]:
    """Lines of as many words as there are columns, from the last line upwards."""
    dialect, width = form.dialect, form.width
    rows: list[list[str]] = []
    between = 0
    for line in reversed(preamble):
        if not line.strip() or _RULE.match(line.strip().lstrip("#%!;*/")):
            continue
        if width > 1 and _SECTION.match(line):
            continue
        fields = _fields(line, form)
        if fields is not None and not rows and between and not _is_heading(fields):
            fields = None  # words a few lines above the rows are a heading only if they look so
        if fields is not None:
            rows.append(fields)
        elif rows or between == most_between:
            break
        elif not form.transposed and _is_setting(line, dialect, width):
            break
        between += fields is None
        if len(rows) == MOST_ROWS:
            break
    return rows


def _fields(line: str, form: _Form) -> list[str] | None:
    """Fields of a line of words; None where it does not have one for each column."""
    dialect, width = form.dialect, form.width
    # A delimiter in front is an empty field, as above a clock without a unit, and no mark.
    marks = _MARKS.replace(dialect.delimiter, "") if dialect.delimiter else _MARKS
    for text in dict.fromkeys((line.lstrip(marks), line.lstrip(_MARKS), line.strip("\r\n"))):
        for split in _ways_to_split(text, dialect):
            if (
                sum(map(bool, split)) > width
                and split[0].strip(":").casefold() in _KEY_OF_NAMES
            ):
                split = split[1:]
            elif form.keyed and len(split) == width + 1 and (
                _is_key(split[0]) or not _begins_names(split[0])
            ):  # fmt: skip
                split = split[1:]
            fields = _fitted(split, form)
            if fields is None or _are_keys(fields):
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


def _are_keys(fields: Sequence[str]) -> bool:
    """Whether fields are keys before their values: some, or the first, end in a colon."""
    ends = [field.endswith(":") for field in fields]
    if ends[0] and len(ends) > 1:
        return True
    return any(ends[:-1]) and (sum(ends) * 2 > len(ends) or not _is_heading(fields))


def _ways_to_split(text: str, dialect: Dialect) -> list[list[str]]:
    ways = [dialect.split(text)]
    mark = dialect.delimiter
    if mark is not None and '"' not in text and any(
        mark in found[0] for found in _IN_BRACKETS.finditer(text)
    ):  # fmt: skip
        hidden = _IN_BRACKETS.sub(lambda found: found[0].replace(mark, _HIDDEN), text)
        shown = [field.replace(_HIDDEN, mark) for field in dialect.split(hidden)]
        ways.insert(0, shown)
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


def _fitted(fields: list[str], form: _Form) -> list[str] | None:
    """One field for each column; one beyond may be of a column without rows."""
    width = form.width
    spare = form.dialect.delimiter is not None
    if len(fields) < width or not any(fields):
        return None
    if sum(map(bool, fields[:width])) * 2 < width:
        return None
    # More than one word too many, and the line is a sentence.
    if len(fields) > width + spare and any(fields[width + spare :]):
        return None
    if spare and any(fields[width:]) and form.closed:
        first_is_name = form.running and not is_time_name(fields[1])
        if not first_is_name and not _begins_names(fields[0]):
            return None  # nobody knows whether the first or the last is no name
    return fields[:width]


def _begins_names(field: str) -> bool:
    """Whether the first field of a line is the name of a column, not a key before names."""
    return (
        is_time_name(field)
        or _X_AXIS.search(field) is not None
        or has_unit(field)
        or _CHANNEL_WORD.search(field) is not None
    )


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
    hits = sum(_is_unit_word(f) or f.strip("[]()").casefold() in _PROCESSING for f in said)
    # Channels may be called x, y, z, a or v, but hardly all of them like units.
    first_is_name = bool(said) and is_time_name(said[0]) and not looks_like_unit(said[0])
    return bool(said) and hits * 2 >= len(said) and not first_is_name


def _is_unit_word(text: str) -> bool:
    return looks_like_unit(text) or (len(text) > 3 and unit_of(text) is not None)


def _are_only_units(fields: Sequence[str]) -> bool:
    """Whether words that stand alone above the rows are units and could not be names."""
    return all(looks_like_unit(field) for field in fields if field) and any(
        re.search(r"[\[\]/^²]", field) for field in fields
    )


def _is_heading(fields: Sequence[str]) -> bool:
    """Whether there is positive evidence that the words are names of columns."""
    bracketed = sum(map(has_unit, fields))
    named = sum(bool(_CHANNEL_WORD.search(field)) for field in fields)
    timed = sum(map(is_time_name, fields))
    return bool(bracketed) or is_time_name(fields[0]) or (named + timed) * 2 >= len(fields)


def _are_settings(rows: Sequence[Sequence[str]]) -> bool:
    """Whether lines one above the other are settings, a key and its value each."""
    if len(rows[0]) == 1:
        return bool(re.search(r"[:=]", rows[0][0]))
    return len(rows) > 2 and len(rows[0]) <= 3


def _bare_unit(field: str) -> str:
    bare = field.strip()
    for opening, closing in ("[]", "()", "<>"):
        if bare.startswith(opening) and bare.endswith(closing):
            bare = bare[1:-1]
    return "" if bare.casefold() in _PROCESSING - {"ts"} or bare in ("-", "TS") else bare
