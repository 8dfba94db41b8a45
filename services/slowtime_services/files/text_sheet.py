"""Conversion of text of any delimiter to a sheet."""

import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from slowtime_services.files.binary.signatures import refuse_binary
from slowtime_services.files.formats import FORMATS
from slowtime_services.files.headings.common_unit import stated_unit
from slowtime_services.files.headings.sampling import find_facts
from slowtime_services.files.headings.start_time import stated_start
from slowtime_services.files.reading_options import DateOrder
from slowtime_services.files.record import RecordError, looks_like_unit
from slowtime_services.files.sheet import Column, ColumnKind, Sheet
from slowtime_services.files.times.stamps import read_stamps
from slowtime_services.files.times.zones import stated_zone

from .delimited.column_names import read_heading
from .delimited.dialect import (
    HEAD_LINES,
    LONGEST_FIELD,
    LONGEST_LINE,
    ColumnLayout,
    Dialect,
    Kind,
    find_layout,
    longest_rows,
    no_rows,
)
from .delimited.encoding import decode
from .delimited.oscilloscopes import plain_table

_LONG_WORD = re.compile(r"([^\s,;|]{1000})[^\s,;|]+")
"""A word that no number or name is as long as; cut, its line keeps its fields."""
HEAD_CHARACTERS = 1 << 20
"""Of a text, in which its first lines are looked for [1]."""
MOST_BEYOND = 0.2
"""Share of rows [1] that may have a value in a last column whose other rows end empty."""
MOST_FOOTER = 12
"""Lines of words that may stand below the rows."""
_STATISTIC = re.compile(
    r"(?:(?:abs(?:olute)?|arithmetic)[ .]*)?(?:max(?:imum|imal)?|min(?:imum|imal)?|mean|"
    r"average|avg|ave|rms|std\.?(?:[ .]*dev(?:iation)?)?|stdev|sigma|var(?:iance)?|median|sum|"
    r"summe|total|peak|pk-pk|p-p|range|count|mittel(?:wert)?|moyenne|media|promedio)"
    r"(?:[ .]*(?:value|abs|wert|[\[(].{1,12}[\])]))?\.?",
    re.I,
)
"""What begins a line of statistics below the rows."""
_SERIAL_STAMP = re.compile(r"(\d{1,2}:\d{2}:\d{2}[.,]\d+)\s*->\s*")
"""What the Arduino IDE puts before each line that it logs."""
_LABELLED = re.compile(
    r"\s*([^\W\d][\w./^² ()\[\]-]{0,30}?)\s*[:=]\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)"
)


def read_text(
    path: Path, *, skip_lines: int | None = None, date_order: DateOrder | None = None
) -> Sheet:
    """Read a text file of numbers, stamps and words.

    Parameters
    ----------
    skip_lines
        Lines before the first row; found out if None.
    date_order
        Order of day, month and year in dates with slashes; found out if None.

    Raises
    ------
    RecordError
        Where there are no rows, or a line is not like the others.
    """
    refuse_binary(path)
    text = decode(path)
    if skip_lines is None:
        _refuse_without_rows(text, path.name)
    return read_lines(text.splitlines(), path.name, skip_lines, date_order)


def _refuse_without_rows(text: str, name: str) -> None:
    """Refuse a long text that begins without rows, before it is parted into all its lines."""
    head = text[:HEAD_CHARACTERS].splitlines()[:HEAD_LINES]
    whole = len(text) > HEAD_CHARACTERS and len(head) == HEAD_LINES
    if not whole or any(form.reader.recognise(head) for form in FORMATS):
        return
    plain = _without_monitor_prefixes(plain_table(head))
    if longest_rows(plain[:HEAD_LINES], 0) is None:
        raise no_rows(head, name, None)


def read_lines(
    lines: list[str],
    name: str,
    skip_lines: int | None = None,
    date_order: DateOrder | None = None,
) -> Sheet:
    """Read the lines of a file called `name`, as `read_text` does."""
    if not any(line.strip() for line in lines):
        raise RecordError(f"{name} is empty. Give a file with at least two rows of numbers.")
    _refuse_long_lines(lines[:HEAD_LINES], name)
    lines[:HEAD_LINES] = [
        line if len(line) <= LONGEST_LINE else _LONG_WORD.sub(r"\1", line)[:LONGEST_LINE]
        for line in lines[:HEAD_LINES]
    ]
    if skip_lines is None:
        for form in FORMATS:
            if form.reader.recognise(lines[:HEAD_LINES]):
                return form.reader.read(lines, name)
    return _read_table(
        _without_monitor_prefixes(plain_table(lines)), name, skip_lines, date_order
    )


def _refuse_long_lines(head: Sequence[str], name: str) -> None:
    """Refuse a text of lines that no layout is looked for in, before any of them is parted."""
    long = sum(len(line) > LONGEST_LINE for line in head)
    if 2 * long > len(head):
        raise RecordError(
            f"{name} has lines of more than {LONGEST_LINE:,} characters. Give a row for each "
            "sample, or save the table as NumPy."
        )


def _without_monitor_prefixes(lines: list[str]) -> list[str]:
    """Remove what a serial monitor or plotter adds to each line."""
    head = [line for line in lines[:HEAD_LINES] if line.strip()]
    if sum(bool(_SERIAL_STAMP.match(line)) for line in head) > 0.8 * len(head):
        body = _SERIAL_STAMP.sub("", head[-1])
        mark = next((m for m in ("\t", ";", ",") if m in body), ",")
        lines = [_SERIAL_STAMP.sub(rf"\1{mark}", line, count=1) for line in lines]
        head = [line for line in lines[:HEAD_LINES] if line.strip()]
    labels = [_labels(line) for line in head[-3:]]
    if len(head) >= 3 and labels[0] and all(found == labels[0] for found in labels):
        width = len(labels[0])
        rows = [(_LABELLED.findall(line), line) for line in lines]
        values = [
            ";".join(value.rstrip(",.") for _, value in found)
            for found, line in rows
            if len(found) == width and tuple(name for name, _ in found) == labels[0]
        ]
        return [";".join(labels[0]), *values]
    return lines


def _labels(line: str) -> tuple[str, ...]:
    """Labels of a line such as ``ax:0.12,ay:0.30``; none where it is another."""
    if len(line) > 2000:
        return ()
    found = _LABELLED.findall(line)
    rest = re.sub(r"[\s,;|]|m/s[\^²]?2?|deg|°", "", _LABELLED.sub("", line))
    return tuple(name for name, _ in found) if found and not rest else ()


def _read_table(
    lines: list[str], name: str, skip_lines: int | None, date_order: DateOrder | None
) -> Sheet:
    layout = find_layout(lines, name, skip_lines)
    dialect, preamble = layout.dialect, lines[: layout.first]
    names, units, said_names = read_heading(preamble, layout, lines[layout.first :])
    total = len(lines)
    lines, footer = _without_footer(lines, layout)
    said_footer = _describe_statistics(footer, total, layout)
    mark = dialect.delimiter
    facts = find_facts(preamble, dialect.decimal, 1, mark)
    if footer:
        facts = facts.joined(find_facts(footer, dialect.decimal, len(lines) + 1, mark))
    named = bool(names) and any(names)
    zone = stated_zone([*preamble, *footer])
    start = stated_start([*preamble, *footer], date_order, zone)
    rows = _FileRows(lines, layout, names or ("",) * len(units), units, date_order)
    columns, tail, notes = rows.read()
    return Sheet(
        columns=columns,
        named=named,
        facts=facts,
        tail=tail,
        unit=stated_unit(preamble),
        start_ns=start.ns,
        start_said=start.said,
        start_zone=start.zone,
        zone=zone,
        notes=(*said_names, *said_footer, *notes),
        assumptions=(
            f"{dialect.decimal!r} in numbers parts thousands, since three digits follow each",
        )
        * dialect.grouped,
        first_line=layout.first + 1,
    )


def _without_footer(lines: list[str], layout: ColumnLayout) -> tuple[list[str], list[str]]:
    """Rows and the lines of words below them."""
    end = len(lines)
    while end > layout.first and not lines[end - 1].strip():
        end -= 1
    top = end
    while top > max(layout.first + 1, end - MOST_FOOTER) and _is_footer(lines[top - 1], layout):
        top -= 1
    if _is_footer(lines[top - 1], layout):
        return lines[:end], []  # too long for a footer: a fault of the rows, which is named
    return lines[:top], lines[top:end]


def _is_footer(line: str, layout: ColumnLayout) -> bool:
    if not line.strip():
        return True
    fields = layout.dialect.split(line) if len(line) < 2000 else [line]
    kinds = [layout.dialect.kind(field) for field in fields]
    alike = sum(one == other for one, other in zip(kinds, layout.kinds, strict=False))
    if _states_statistic(fields, layout):
        return True
    return bool(re.search(r"[^\W\d_]{3}", line)) and alike * 2 < max(len(layout.kinds), 2)


def _states_statistic(fields: Sequence[str], layout: ColumnLayout) -> bool:
    """Whether a line begins with a word such as ``Max`` where rows have a number or a stamp."""
    stated = layout.kinds[0] != "word" and layout.dialect.kind(fields[0]) == "word"
    return stated and _STATISTIC.fullmatch(fields[0].strip(" :#")) is not None


def _describe_statistics(
    footer: Sequence[str], total: int, layout: ColumnLayout
) -> tuple[str, ...]:
    """Note that lines of statistics below the rows were left out."""
    found = [
        total - len(footer) + place + 1
        for place, line in enumerate(footer)
        if line.strip() and _states_statistic(layout.dialect.split(line), layout)
    ]
    if not found:
        return ()
    return (f"Statistics below the rows, from line {found[0]} on, were left out.",)


class _FileRows:
    """Rows of one file: all by the quick reader, or one by one where it stumbles."""

    def __init__(
        self,
        lines: list[str],
        layout: ColumnLayout,
        names: tuple[str, ...],
        units: tuple[str, ...],
        date_order: DateOrder | None,
    ) -> None:
        self._lines, self._layout = lines, layout
        self._names, self._units, self._order = names, units, date_order

    def read(self) -> tuple[tuple[Column, ...], tuple[float, ...], tuple[str, ...]]:
        """Columns, values of a short last row, and notes."""
        kinds = self._layout.kinds
        if set(kinds) == {"number"}:
            values = self._quickly()
            if values is not None:
                columns = [
                    Column(n, u, v)
                    for n, u, v in zip(self._names, self._units, values.T, strict=True)
                ]
                return tuple(columns), (), ()
        fields, numbers, tail, notes = self._with_care()
        made = [
            self._column(i, list(texts), numbers)
            for i, texts in enumerate(zip(*fields, strict=True))
        ]
        return tuple(made), tail, notes

    def _quickly(self) -> Float[np.ndarray, "row column"] | None:
        dialect, body = self._layout.dialect, self._lines[self._layout.first :]
        if any('"' in line or "'" in line for line in body[:3]):
            return None
        mark = dialect.delimiter
        if mark is not None and dialect.ends_open(body[0]):
            body = [line.rstrip(" \r").removesuffix(mark) for line in body]
        text = "\n".join(body)
        if dialect.grouped:
            text = text.replace(dialect.decimal, "")
        elif dialect.decimal != ".":
            text = text.replace(",", ".")
        try:
            values = np.loadtxt(io.StringIO(text), delimiter=mark, comments=None, ndmin=2)
        except ValueError:
            return None  # the careful reader says what is wrong, and where
        good = values.shape[1] == len(self._layout.kinds) and np.isfinite(values).all()
        return values if good else None

    def _with_care(
        self,
    ) -> tuple[list[list[str]], list[int], tuple[float, ...], tuple[str, ...]]:
        """Fields of all rows, the lines they stand on, and what is left of the last."""
        lines, dialect, kinds = self._lines, self._layout.dialect, self._layout.kinds
        width = len(kinds)
        rows: list[list[str]] = []
        numbers: list[int] = []
        heading = {line.strip() for line in lines[: self._layout.first] if line.strip()}
        repeated: list[str] = []
        last = max(index for index, line in enumerate(lines) if line.strip())
        beyond: list[tuple[int, str]] = []
        opens = dialect.ends_open(lines[self._layout.first])
        for index in range(self._layout.first, last + 1):
            if not lines[index].strip():
                continue
            if lines[index].strip() in heading:
                repeated.append(str(index + 1))
                continue
            fields = dialect.split(lines[index])
            if width > len(fields) >= width - 2 and dialect.ends_open(lines[index]):
                fields += [""] * (width - len(fields))
            if width > len(fields) and dialect.delimiter and _only_open(kinds, len(fields)):
                fields += [""] * (width - len(fields))
            if index == last and len(fields) < width and rows:
                said = f"The last line ({index + 1}) is cut short and was left out."
                more = (*_restarts(repeated), *_describe_beyond(beyond), said)
                return rows, numbers, _tail(fields, dialect), more
            if len(fields) > width and not any(fields[width:]):
                del fields[width:]
            if len(fields) == width + 1 and opens:
                beyond.append((index + 1, fields.pop()))
            if len(fields) != width or len(beyond) > MOST_BEYOND * len(rows) + 1:
                if beyond and beyond[-1][0] == index + 1:
                    fields.append(beyond[-1][1])
                raise RecordError(
                    f"Line {index + 1} has {len(fields)} fields, the lines before it {width}. "
                    "Correct or remove that line; if the first rows are not data, skip them "
                    "with --reading skip_lines."
                )
            rows.append(fields)
            numbers.append(index + 1)
        return rows, numbers, (), (*_restarts(repeated), *_describe_beyond(beyond))

    def _column(self, at: int, texts: list[str], numbers: Sequence[int]) -> Column:
        name, unit, kind = self._names[at], self._units[at], self._layout.kinds[at]
        if kind in ("stamp", "date", "clock"):
            return self._stamped(at, texts, numbers, kind)
        if kind == "word" and (said := _with_unit(texts)) is not None:
            texts, unit, kind = said[0], said[1], "number"
        if kind == "word":
            return Column(name, unit, np.array(texts, dtype=object), "word")
        dialect = self._layout.dialect
        plain = dialect.decimal == "." and not dialect.grouped
        values = np.empty(len(texts))
        missing = None
        for row, text in enumerate(texts):
            try:
                quick = plain and "_" not in text and len(text) <= LONGEST_FIELD
                value = float(text) if quick else self._number(text, numbers[row])
            except ValueError:
                value = self._number(text, numbers[row])
            if np.isnan(value):
                missing = missing or (numbers[row], at + 1, text)
            elif np.isinf(value) and "inf" not in text.casefold():
                raise RecordError(
                    f"Line {numbers[row]} has {text[:40]!r}: it is larger than 1.8e308, the "
                    "largest number. Correct or remove that line."
                )
            elif np.isinf(value) and (missing is None or not np.isinf(values[:row]).any()):
                missing = (numbers[row], at + 1, text)
            values[row] = value
        return Column(name, unit, values, "number", None, missing)

    def _number(self, text: str, line: int) -> float:
        dialect = self._layout.dialect
        if dialect.kind(text) not in ("number", "missing"):
            raise RecordError(
                f"Line {line} has {text[:40]!r} where a number should be. Correct or "
                "remove that line, or give the number of lines before the numbers with "
                "--reading skip_lines."
            )
        return dialect.number(text)

    def _stamped(
        self, at: int, texts: list[str], numbers: Sequence[int], kind: ColumnKind
    ) -> Column:
        try:
            stamps = read_stamps(texts, self._order)
        except ValueError as error:
            said, row = error.args if len(error.args) == 2 else (str(error), 0)
            raise RecordError(
                f"Line {numbers[row]}, field {at + 1}: {said}. Correct or remove that line."
            ) from error
        return Column(self._names[at], self._units[at], stamps.ns, kind, stamps)


_VALUE_AND_UNIT = re.compile(r"(\S+)\s+([a-zA-Zµ°%][\w/²^]{0,9})")


def _with_unit(texts: Sequence[str]) -> tuple[list[str], str] | None:
    """Numbers and their unit, where each field is one and the other, such as ``0.01 sec``."""
    found = [_VALUE_AND_UNIT.fullmatch(text) for text in texts[:HEAD_LINES]]
    units = {match.group(2) if match else "" for match in found}
    unit = units.pop()
    if units or not unit or not looks_like_unit(unit):
        return None
    return [text.removesuffix(unit).strip() for text in texts], unit


def _restarts(repeated: Sequence[str]) -> tuple[str, ...]:
    """Describe on which lines the heading is repeated, because a logger restarted."""
    if not repeated:
        return ()
    more = ", ..." if len(repeated) > 3 else ""
    return (
        f"The heading stands again in line {', '.join(repeated[:3])}{more}, as where a logger "
        "restarted or files were joined; without a clock, samples lost there cannot be seen.",
    )


def _describe_beyond(beyond: Sequence[tuple[int, str]]) -> tuple[str, ...]:
    """Note what stands in a last column that is empty in nearly all rows."""
    if not beyond:
        return ()
    line, text = beyond[0]
    rows = "1 row" if len(beyond) == 1 else f"{len(beyond)} rows"
    return (
        f"The last column is empty but for {rows} (line {line}: {text[:40]!r}) and was left "
        "out.",
    )


def _only_open(kinds: Sequence[Kind], present: int) -> bool:
    """Whether the columns that a line lacks may be empty in every line."""
    return all(kind == "missing" for kind in kinds[present:])


def _tail(fields: Sequence[str], dialect: Dialect) -> tuple[float, ...]:
    def values() -> Iterator[float]:
        for field in fields:
            if not dialect.is_number(field):
                return
            yield dialect.number(field)

    return tuple(values())
