"""The dialect of a text file: delimiter, decimal mark and kinds of fields."""

import csv
import dataclasses
import functools
import re
from collections.abc import Iterator, Sequence
from typing import Literal

from slowtime_services.files.record import RecordError
from slowtime_services.files.times.stamps import kind_of

HEAD_LINES = 400
LONGEST_FIELD = 64
"""Characters of the longest number or stamp; what is longer is words."""
LONGEST_LINE = 200_000
"""Characters of a line from which it is not looked at as a row of the head."""
LEAST_MARKED = 5
"""Numbers with marks before three digits [1] from which these can be marks of thousands."""
LEAST_SHARE_SMALL = 0.01
"""Share of whole numbers below 1000 [1] in a column in which marks part thousands: of numbers
with three decimals, less zeros at the end, a thousandth is whole."""
MAX_DISTINCT_SHARE = 0.5
"""Share of different words in a column [1] from which it is a heading's text, not a state that
a logger repeats."""

Kind = Literal["number", "missing", "stamp", "date", "clock", "word"]

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$|[+-]?(nan|inf|infinity)$", re.I)
_POINT_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:(?:,\d{3})+\.\d*|(?:,\d{3}){2,})$")
_COMMA_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:(?:\.\d{3})+,\d*|(?:\.\d{3}){2,})$")
_COMMA_NUMBER = re.compile(
    r"[+-]?(\d+,?\d*|,\d+)([eEdD][+-]?\d+)?$|[+-]?(nan|inf|infinity)$", re.I
)
_GLUED = re.compile(r"[+-]?\d*\.\d+(?:[eEdD][+-]?\d+)?(?:[+-]\d*\.\d+(?:[eEdD][+-]?\d+)?)+")
_ONE_GLUED = re.compile(r"[+-]?\d*\.\d+(?:[eEdD][+-]?\d+)?")
MISSING = frozenset(
    ("", "na", "n/a", "#n/a", "#na", "nan", "null", "none", "-", "--", "---", "#value!",
     "#num!", "#div/0!", "#ref!", "nil", "missing", "<na>", "nat", "?", "1.#qnan", "-1.#ind",
     "1.#ind",
     "-nan(ind)", "nan(ind)", "-nan", "overflow", "overrange", "invalid", "overload", "ovld",
     "ovl", "ol", "+ol", "-ol", "o.l", "over", "+over", "-over", "err", "error", "#err",
     "no data", "nodata", "no value", "n.a.", "n.a", "1.#inf", "-1.#inf", "+1.#inf",
     *("*" * count for count in range(1, 17)), *("#" * count for count in range(2, 17)))
)  # fmt: skip
"""Words that stand for a value which is not there."""


@dataclasses.dataclass(frozen=True, slots=True)
class Dialect:
    """Delimiter and decimal mark of one file."""

    delimiter: str | None
    """None is any run of blanks."""
    decimal: str
    grouped: bool = False
    """Whether the decimal mark stands between thousands of whole numbers instead."""

    def split(self, line: str) -> list[str]:
        """Fields of a line; one delimiter left over at the end of the line closes nothing."""
        line = line.strip() if self.delimiter in (None, " ") else line.strip(" \r\n\ufeff")
        if self.delimiter is not None and line.endswith(self.delimiter):
            line = line[: -len(self.delimiter)]
        if '"' in line:
            return self._split_quoted(line)
        fields = [field.strip().strip("'").strip() for field in line.split(self.delimiter)]
        if self.delimiter is None and any(_GLUED.fullmatch(field) for field in fields):
            return [part for field in fields for part in _unglued(field)]
        return fields

    def _split_quoted(self, line: str) -> list[str]:
        mark = self.delimiter or " "
        text = line if self.delimiter else " ".join(line.replace("\t", " ").split(" "))
        try:
            fields = next(csv.reader([text], delimiter=mark, skipinitialspace=True))
        except (csv.Error, StopIteration):
            fields = line.split(self.delimiter)
        if self.delimiter is None:
            fields = [field for field in fields if field]
        return [field.strip().strip("\"'").strip() for field in fields]

    def ends_open(self, line: str) -> bool:
        """Whether a delimiter is the last thing on a line."""
        return self.delimiter is not None and line.rstrip(" \r\n").endswith(self.delimiter)

    def is_number(self, field: str) -> bool:
        """Whether a field is a number in this dialect."""
        if len(field) > LONGEST_FIELD:
            return False
        if self.decimal == ".":
            return bool(_NUMBER.match(field) or _POINT_THOUSANDS.match(field))
        return bool(_COMMA_NUMBER.match(field) or _COMMA_THOUSANDS.match(field))

    def kind(self, field: str) -> Kind:
        """Kind of a field in this dialect."""
        return "word" if len(field) > LONGEST_FIELD else _kind(self, field)

    def with_point(self, field: str) -> str:
        """Write a field with a decimal point and without marks between thousands."""
        if self.grouped:
            return field.replace(self.decimal, "")
        if self.decimal == ".":
            return field.replace(",", "") if _POINT_THOUSANDS.match(field) else field
        if _COMMA_THOUSANDS.match(field):
            field = field.replace(".", "")
        return field.replace(",", ".")

    def number(self, field: str) -> float:
        """Value of a field that is a number; NaN of one that is missing."""
        if field.casefold() in MISSING:
            return float("nan")
        return float(self.with_point(field).replace("d", "e").replace("D", "e"))


@functools.lru_cache(maxsize=1 << 15)
def _kind(dialect: Dialect, field: str) -> Kind:
    if dialect.is_number(field):
        return "number"
    if field.casefold() in MISSING:
        return "missing"
    return _stamp_kind(field) or "word"


_stamp_kind = functools.lru_cache(maxsize=1 << 15)(kind_of)

DIALECTS = (
    Dialect("\t", "."), Dialect(";", "."), Dialect(",", "."), Dialect("|", "."),
    Dialect(None, "."), Dialect("\t", ","), Dialect(";", ","), Dialect("|", ","),
    Dialect(None, ","), Dialect(",", ","),
)  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True)
class ColumnLayout:
    """Line of the first row, and the kind of each column."""

    dialect: Dialect
    first: int
    kinds: tuple[Kind, ...]


def find_layout(lines: Sequence[str], name: str, skip: int | None) -> ColumnLayout:
    """Find the dialect in which most of the head reads as rows of one shape.

    Raises
    ------
    RecordError
        Where no dialect gives rows with a number in them.
    """
    offset = skip or 0
    layout = longest_rows(lines[offset : offset + HEAD_LINES], offset)
    if layout is None:
        raise no_rows(lines, name, skip)
    _refuse_split_decimals(lines, layout, name)
    return _with_thousands(lines, layout, name)


def longest_rows(head: Sequence[str], offset: int) -> ColumnLayout | None:
    """Find the layout with the most rows in the first lines; None where none has any.

    Parameters
    ----------
    offset
        Lines of the file before these [1].
    """
    best: tuple[tuple[int, int, int], ColumnLayout] | None = None
    for dialect in DIALECTS:
        mark = dialect.delimiter
        if mark is not None and not any(mark in line for line in head):
            continue  # as one column, the lines are read by runs of blanks
        run = _longest_run(head, dialect)
        if run is None or _is_decimal_comma(head[run.first : run.first + run.length], dialect):
            continue
        # Of equally long runs, numbers are sounder than words, and many fields than one.
        words = sum(kind == "word" for kind in run.kinds)
        score = (run.length, -words, len(run.kinds) if dialect.delimiter else 1)
        if best is None or score > best[0]:
            first = offset + _first_row(head, dialect, run)
            best = score, ColumnLayout(dialect, first, run.kinds)
    return None if best is None else best[1]


def _with_thousands(lines: Sequence[str], layout: ColumnLayout, name: str) -> ColumnLayout:
    """Take decimal marks for marks between thousands, where they can be no others.

    Decimals are written with the same number of digits in each row, or without zeros at their
    end, and numbers below one begin with a zero. Marks that always stand before three digits,
    in a column that has whole numbers below 1000, too, and no number below one, part thousands.

    Raises
    ------
    RecordError
        Where quoted numbers between commas all have three digits behind a comma.
    """
    dialect, mark = layout.dialect, layout.dialect.decimal
    three = re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+")
    numbers = [place for place, kind in enumerate(layout.kinds) if kind == "number"]
    marked: dict[int, int] = dict.fromkeys(numbers, 0)
    for row in _rows_with(mark, lines, layout):
        for place in numbers:
            if mark in row[place]:
                if three.fullmatch(row[place]) is None:
                    return layout
                marked[place] += 1
    places = [place for place, count in marked.items() if count]
    if not places:
        return layout
    small = dict.fromkeys(places, 0)
    for row in _rows_with("", lines, layout):
        for place in places:
            size = row[place].lstrip("+-")
            if size.isdigit():
                if len(size) > len("999"):
                    return layout
                small[place] += 1
    shares = [small[place] / (marked[place] + small[place]) for place in places]
    if sum(marked.values()) >= LEAST_MARKED and max(shares) >= LEAST_SHARE_SMALL:
        return dataclasses.replace(layout, dialect=dataclasses.replace(dialect, grouped=True))
    if dialect == Dialect(",", ","):
        raise RecordError(
            f"In {name}, each comma in numbers stands before three digits "
            f"({lines[layout.first][:60]!r}): it may part thousands or begin decimals. Save it "
            "with decimal points and without marks between thousands."
        )
    return layout


def _rows_with(mark: str, lines: Sequence[str], layout: ColumnLayout) -> Iterator[list[str]]:
    """Fields of rows of the expected number that contain a mark."""
    dialect, width = layout.dialect, len(layout.kinds)
    for line in lines[layout.first :]:
        if line.strip() and mark in line and len(fields := dialect.split(line)) == width:
            yield fields


def _refuse_split_decimals(lines: Sequence[str], layout: ColumnLayout, name: str) -> None:
    """Ask about commas that part numbers and, it seems, their decimals, too.

    Decimals are whole numbers without a sign, some of which begin with zeros. Where such
    columns stand at every second place, or the heading has fewer names than there are columns,
    or a whole number is ``-0``, they are the decimals of the column in front.
    """
    if layout.dialect != Dialect(",", ".") or len(layout.kinds) < 3:
        return
    rows = [layout.dialect.split(line) for line in lines[layout.first :][:60] if line.strip()]
    rows = [row for row in rows if len(row) == len(layout.kinds)]
    columns = [
        column if kind == "number" else None
        for kind, column in zip(layout.kinds, zip(*rows, strict=True), strict=True)
    ]
    if any(c is not None and not all(map(_is_whole, c)) for c in columns):
        return
    decimals = [
        place
        for place in range(1, len(columns))
        if _are_decimals(columns[place]) and columns[place - 1] is not None
    ]
    padded = [
        place for place in decimals if any(re.match(r"0\d", f) for f in columns[place] or ())
    ]
    named = len(layout.dialect.split(lines[layout.first - 1])) if layout.first else 0
    paired = len(columns) >= 4 and set(range(1, len(columns), 2)) <= set(decimals)
    fewer = 0 < len(columns) - named <= len(decimals) and named > 1
    signed = any("-0" in (columns[place - 1] or ()) for place in decimals)
    if padded and ((paired and len(columns) % 2 == 0) or fewer or signed):
        raise RecordError(
            f"In {name}, commas stand between numbers and, it seems, before their decimals, "
            f"too ({lines[layout.first][:60]!r}). Save it with semicolons or tabs between "
            "numbers, or with decimal points."
        )


def _is_whole(field: str) -> bool:
    return re.fullmatch(r"[+-]?\d+(?:[eE][+-]?\d+)?|", field) is not None


def _are_decimals(column: Sequence[str] | None) -> bool:
    """Whether all fields of a column may be digits behind a decimal mark."""
    return column is not None and all(
        re.fullmatch(r"\d+(?:[eE][+-]?\d+)?", field) for field in column
    )


def no_rows(lines: Sequence[str], name: str, skip: int | None) -> RecordError:
    """Say that the first lines have no row of numbers, and what one is."""
    offset = skip or 0
    if offset >= len(lines):
        return RecordError(
            f"{name} has {len(lines)} lines, fewer than skip_lines={skip}. Lower --reading "
            "skip_lines."
        )
    return RecordError(
        f"No row of numbers in the first {HEAD_LINES} lines of {name} "
        f"(line {offset + 1} is {lines[offset][:60]!r}). A row is numbers, with or without a "
        "date or time such as 2024-04-21T15:00:00.010Z or 21.04.2024 15:00:00. Give the "
        "number of lines before the numbers with --reading skip_lines, or convert the file to "
        "CSV."
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Run:
    first: int
    length: int
    kinds: tuple[Kind, ...]


def _longest_run(head: Sequence[str], dialect: Dialect) -> _Run | None:
    """Longest run of lines whose fields are of the same kinds."""
    best: _Run | None = None
    kinds: list[Kind] = []
    words: list[set[str]] = []
    length = first = 0
    for index, line in enumerate(head):
        if not line.strip():
            continue
        fields = dialect.split(line) if len(line) <= LONGEST_LINE else [line[:LONGEST_FIELD]]
        new: list[Kind] = [dialect.kind(field) for field in fields]
        if dialect == Dialect(",", ",") and '"' not in line:
            new = ["word"] * len(fields)  # such numbers need quotes
        merged = _merged(kinds, new) if length else None
        if merged is None:
            kinds, words, length, first = new, [set() for _ in new], 0, index
        else:
            kinds = merged
        if not _may_be_row(kinds, new, length):
            length = 0
            continue
        length += 1
        for seen, field, kind in zip(words, fields, kinds, strict=True):
            if kind == "word":
                seen.add(field)
        repeated = all(len(seen) <= max(1, MAX_DISTINCT_SHARE * length) for seen in words)
        if repeated and (best is None or length > best.length):
            best = _Run(first, length, tuple(kinds))
    return best


def _may_be_row(kinds: Sequence[Kind], new: Sequence[Kind], length: int) -> bool:
    """Whether there is a number, or, within a run, a stamp beside a value that is missing."""
    if "number" in new:
        return True
    stamped = any(kind in ("stamp", "clock") for kind in new) or "word" not in new
    return bool(length) and "number" in kinds and "missing" in new and stamped


def _merged(kinds: Sequence[Kind], new: Sequence[Kind]) -> list[Kind] | None:
    """Kinds that both rows are of; None where they differ."""
    if len(kinds) != len(new):
        return None
    merged: list[Kind] = []
    for one, other in zip(kinds, new, strict=True):
        if one == other or other == "missing":
            merged.append(one)
        elif one == "missing":
            merged.append(other)
        else:
            return None
    return merged


def is_row(fields: Sequence[str], layout_kinds: Sequence[Kind], dialect: Dialect) -> bool:
    """Whether fields are those of a row of these kinds."""
    new: list[Kind] = [dialect.kind(field) for field in fields]
    return "number" in new and _merged(layout_kinds, new) is not None


def _first_row(head: Sequence[str], dialect: Dialect, run: _Run) -> int:
    """Where the rows begin; a bad line among the first does not make those a preamble."""
    width = len(run.kinds)
    rows = [index for index, line in enumerate(head) if line.strip()]
    good = {
        index
        for index in rows
        if index >= run.first or is_row(dialect.split(head[index]), run.kinds, dialect)
    }
    for at, index in enumerate(rows):
        if index not in good:
            continue
        above = dialect.split(head[rows[at - 1]].lstrip("#%!; ")) if at else []
        named = len(above) == width and not any(map(dialect.is_number, above)) and any(above)
        if at == 0 or named or index == run.first or good.issuperset(rows[at : at + 3]):
            return index
    return run.first


def _is_decimal_comma(rows: Sequence[str], dialect: Dialect) -> bool:
    """Whether "0,05" is one number: as two, the second would begin with a needless zero."""
    if dialect != Dialect(",", "."):
        return False
    second = [fields[1] for row in rows if len(fields := dialect.split(row)) == 2]
    return any(re.match(r"0\d", field) for field in second)


def _unglued(field: str) -> list[str]:
    """Numbers of a Fortran listing that touch: ``1.581-999.0``."""
    return _ONE_GLUED.findall(field) if _GLUED.fullmatch(field) else [field]
