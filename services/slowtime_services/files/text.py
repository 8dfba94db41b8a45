"""Text of any delimiter, with or without header: found out by looking at its first lines."""

import dataclasses
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from .record import RecordError, looks_like_unit

HEAD_LINES = 400
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$|[+-]?(nan|inf|infinity)$", re.I)
_RATE = re.compile(
    r"(?:sampl\w*[\s_-]*(?:rate|freq\w*)|\bfs)\b[^0-9\n]{0,20}?([0-9]+(?:[.,][0-9]+)?(?:e[+-]?\d+)?)",
    re.I,
)


@dataclasses.dataclass(frozen=True, slots=True)
class Dialect:
    """How one file writes numbers."""

    delimiter: str | None
    """None is any run of blanks."""
    decimal: str

    def split(self, line: str) -> list[str]:
        """Fields of a line; one delimiter left over at the end of the line closes nothing."""
        line = line.strip() if self.delimiter in (None, " ") else line.strip(" \r\n\ufeff")
        if self.delimiter is not None and line.endswith(self.delimiter):
            line = line[: -len(self.delimiter)]
        return [field.strip().strip("\"'").strip() for field in line.split(self.delimiter)]

    def ends_open(self, line: str) -> bool:
        """Whether a delimiter is the last thing on a line."""
        return self.delimiter is not None and line.rstrip(" \r\n").endswith(self.delimiter)

    def is_number(self, field: str) -> bool:
        """Whether a field is a number in this dialect."""
        return bool(_NUMBER.match(self.with_point(field)))

    def with_point(self, field: str) -> str:
        """Write a field with a decimal point."""
        return field if self.decimal == "." else field.replace(",", ".")


DIALECTS = (
    Dialect("\t", "."), Dialect(";", "."), Dialect(",", "."), Dialect("|", "."),
    Dialect(None, "."), Dialect("\t", ","), Dialect(";", ","), Dialect("|", ","),
    Dialect(None, ","),
)  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True)
class Table:
    """Numbers of a text file, and what its first lines say of them."""

    values: Float[np.ndarray, "row column"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_line: int
    stated_rate_hz: float | None
    notes: tuple[str, ...]


def read_table(
    path: Path, *, skip_lines: int | None = None, keep_missing: bool = False
) -> Table:
    """Read a text file of numbers.

    Parameters
    ----------
    skip_lines
        Lines before the first row of numbers; found out if None.
    keep_missing
        Whether empty and NaN fields become NaN instead of an error.
    """
    text = _decode(path)
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise RecordError(
            f"{path.name} is empty. Give a file with at least two rows of numbers."
        )
    dialect, first = _find_data(lines, path.name, skip_lines)
    preamble = lines[:first]
    width = len(dialect.split(lines[first]))
    names, units = _header(preamble, dialect, width)
    values, notes = _numbers(lines, first, dialect, width, keep_missing)
    return Table(values, names, units, first + 1, _stated_rate(preamble), notes)


def _decode(path: Path) -> str:
    raw = path.read_bytes()
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError as error:
            raise RecordError(
                f"{path.name} begins as UTF-16 text and is none: {error.reason} at byte "
                f"{error.start}. Allowed: text, .npy, .npz, .mat, .mcap."
            ) from error
    if b"\0" in raw[:4096]:
        raise RecordError(
            f"{path.name} is not text: it holds zero bytes. "
            "Allowed: text, .npy, .npz, .mat, .mcap."
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _find_data(lines: Sequence[str], name: str, skip: int | None) -> tuple[Dialect, int]:
    """Find the dialect in which most of the head reads as rows of equally many numbers."""
    offset = skip or 0
    head = lines[offset : offset + HEAD_LINES]
    best: tuple[int, int, Dialect, int] | None = None
    for dialect in DIALECTS:
        length, start, width = _longest_run(head, dialect, whole=len(head) < HEAD_LINES)
        if length and not _is_decimal_comma(head[start : start + length], dialect):
            score = (length, width if dialect.delimiter else 1)
            if best is None or score > best[:2]:
                best = (*score, dialect, start)
    if best is None:
        raise RecordError(
            f"No row of numbers in the first {HEAD_LINES} lines of {name} "
            f"(line {offset + 1} is {lines[offset][:60]!r}). "
            "Say where they begin with --skip-lines, or convert the file to CSV."
            if offset < len(lines)
            else f"{name} has {len(lines)} lines, fewer than skip_lines={skip}. "
            "Lower --skip-lines."
        )
    return best[2], offset + _first_row(head, best[2], best[3])


def _first_row(head: Sequence[str], dialect: Dialect, inside: int) -> int:
    """Where the rows begin; a bad line among the first does not make those a preamble."""
    width = len(dialect.split(head[inside]))
    rows = [index for index, line in enumerate(head) if line.strip()]
    good = {index for index in rows if _is_row(dialect.split(head[index]), dialect, width)}
    for at, index in enumerate(rows):
        if index not in good:
            continue
        above = dialect.split(head[rows[at - 1]].lstrip("#%!; ")) if at else []
        named = len(above) == width and not any(map(dialect.is_number, above))
        if at == 0 or named or good.issuperset(rows[at : at + 3]):
            return index
    return inside


def _is_row(fields: Sequence[str], dialect: Dialect, width: int) -> bool:
    return len(fields) == width and all(map(dialect.is_number, fields))


def _longest_run(head: Sequence[str], dialect: Dialect, *, whole: bool) -> tuple[int, int, int]:
    """Length, start and width of the longest run of rows with one number of numbers."""
    best, start, width, length = (0, 0, 0), 0, 0, 0
    for index, line in enumerate(head):
        if not line.strip():
            continue
        fields = dialect.split(line)
        numeric = sum(dialect.is_number(field) for field in fields)
        # A row may miss a number; that is for the reader to refuse, with its line.
        row = numeric == len(fields) or (
            length > 0 and numeric and all(f == "" or dialect.is_number(f) for f in fields)
        )
        if row and (len(fields) == width or length == 0):
            length, start = (length + 1, start if length else index)
            width = len(fields)
        elif row:
            length, start, width = 1, index, len(fields)
        else:
            length = 0
        if length > best[0]:
            best = (length, start, width)
    return best


def _is_decimal_comma(rows: Sequence[str], dialect: Dialect) -> bool:
    """Whether "0,05" is one number: as two, the second would begin with a needless zero."""
    if dialect != Dialect(",", "."):
        return False
    second = [fields[1] for row in rows if len(fields := dialect.split(row)) == 2]
    return any(re.match(r"0\d", field) for field in second)


def _header(
    preamble: Sequence[str], dialect: Dialect, width: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units from the last lines above the numbers that have as many fields."""
    rows: list[list[str]] = []
    for line in reversed(preamble):
        fields = dialect.split(line.lstrip("#%!; "))
        fits = len(fields) == width and all(fields) and not any(map(dialect.is_number, fields))
        if rows and not fits:
            break
        if fits:
            rows.append(fields)
    if not rows:
        return (), ("",) * width
    below = rows[0]
    if len(rows) > 1 and sum(map(looks_like_unit, below)) * 2 >= width:
        return tuple(rows[1]), tuple(unit.strip("[]") for unit in below)
    named = [_name_and_unit(field) for field in below]
    return tuple(name for name, _ in named), tuple(unit for _, unit in named)


def _name_and_unit(field: str) -> tuple[str, str]:
    """Split ``"acc [m/s^2]"`` or ``"acc (g)"``."""
    match = re.match(r"(.*\S)\s*[\[(]([^\])]*)[\])]$", field)
    if match and (field.endswith("]") or looks_like_unit(match.group(2))):
        return match.group(1), match.group(2)
    return field, ""


def _stated_rate(preamble: Sequence[str]) -> float | None:
    match = _RATE.search("\n".join(preamble))
    return float(match.group(1).replace(",", ".")) if match else None


def _numbers(
    lines: Sequence[str], first: int, dialect: Dialect, width: int, keep_missing: bool
) -> tuple[Float[np.ndarray, "row column"], tuple[str, ...]]:
    """All rows, by the quick reader; where it stumbles, by one that knows on which line."""
    body = lines[first:]
    if not any('"' in line or "'" in line for line in body[:3]):
        mark = dialect.delimiter
        if mark is not None and dialect.ends_open(body[0]):
            body = [line.rstrip(" \r").removesuffix(mark) for line in body]
        text = "\n".join(body)
        text = text if dialect.decimal == "." else text.replace(",", ".")
        try:
            values = np.loadtxt(io.StringIO(text), delimiter=mark, comments=None, ndmin=2)
        except ValueError:
            pass  # the slow reader below says what is wrong, and where
        else:
            if values.shape[1] == width and (np.isfinite(values).all() or keep_missing):
                return np.where(np.isfinite(values), values, np.nan), ()
    return _numbers_with_care(lines, first, dialect, width, keep_missing)


def _numbers_with_care(
    lines: Sequence[str], first: int, dialect: Dialect, width: int, keep_missing: bool
) -> tuple[Float[np.ndarray, "row column"], tuple[str, ...]]:
    rows: list[list[float]] = []
    notes: list[str] = []
    missing = 0
    last = max(index for index, line in enumerate(lines) if line.strip())
    for index in range(first, last + 1):
        if not lines[index].strip():
            continue
        fields = dialect.split(lines[index])
        if len(fields) == width - 1 and dialect.ends_open(lines[index]):
            fields.append("")
        if index == last and len(fields) < width and rows:
            notes.append(f"The last line ({index + 1}) is cut short and was left out.")
            break
        row = [_number(field, dialect, index) for field in fields]
        if len(row) != width:
            raise RecordError(
                f"Line {index + 1} has {len(row)} fields, the lines before it {width}. Mend or "
                "remove that line; if the first rows are not data, skip them with --skip-lines."
            )
        if not keep_missing and not np.isfinite(row).all():
            column = int(np.flatnonzero(~np.isfinite(row))[0])
            raise RecordError(
                f"Line {index + 1}, field {column + 1} is {fields[column][:40]!r}: not a "
                "finite number. Cut the record there, or fill the value in; the edge agent "
                "can be told to treat such values as dropouts."
            )
        missing += sum(not np.isfinite(value) for value in row)
        rows.append([value if np.isfinite(value) else np.nan for value in row])
    if missing:
        notes.append(f"{missing} values are missing.")
    return np.array(rows, dtype=float), tuple(notes)


def _number(field: str, dialect: Dialect, index: int) -> float:
    if field == "":
        return float("nan")
    if not dialect.is_number(field):
        raise RecordError(
            f"Line {index + 1} has {field[:40]!r} where a number should be. Mend or remove "
            "that line, or say where the numbers begin with --skip-lines."
        )
    return float(dialect.with_point(field).replace("d", "e").replace("D", "e"))
