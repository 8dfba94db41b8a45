"""Excel workbooks as lines of text, by openpyxl: a sheet is a table as any other."""

import datetime
import functools
import importlib.util
import io
import re
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

from slowtime_services.files.record import RecordError

from . import reader_process
from .expansion import unpacked_bound
from .numpy_arrays import refuse_above, unreadable

SUFFIXES = (".xlsx", ".xlsm")
_END_OF_ROWS = re.compile(rb"</(\w{1,40}:)?sheetData\s*>")
_MARK_BYTES = 128
"""Longest end of the rows [bytes]."""
_BLOCK_BYTES = 1 << 16
BYTES_A_CELL = 64
"""Of a cell and its text; a sheet of one cell in its last corner has 1.7e10 of them."""


def lines_of(path: Path, max_bytes: int) -> tuple[list[str], tuple[str, ...]]:
    """Return rows of the sheet with the most cells, fields separated by tabs, and notes.

    Raises
    ------
    RecordError
        Where openpyxl is missing, or the workbook is damaged or empty.
    """
    if importlib.util.find_spec("openpyxl") is None:
        raise RecordError(
            f"{path.name} is an Excel workbook, which openpyxl reads. Install it: "
            "pip install 'slowtime[formats]' or pip install openpyxl. Or save its sheet as CSV."
        )
    told, _ = reader_process.run(__name__, path, max_bytes, "an Excel workbook")
    return told["lines"], tuple(told["notes"])


def main(path: str, max_bytes: str, out: str) -> int:
    """Write lines and notes to `out`, or the reason for failure; in the reader's process."""
    warnings.simplefilter("ignore")  # of what openpyxl does not keep
    try:
        lines, notes = _read(Path(path), int(max_bytes))
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return reader_process.REFUSED
    reader_process.save(out, {"lines": lines, "notes": notes}, [])
    return 0


def _read(path: Path, max_bytes: int) -> tuple[list[str], tuple[str, ...]]:
    import openpyxl

    reader_process.bound_resources(path, max_bytes)
    try:
        with zipfile.ZipFile(path) as archive:
            refuse_above(path, sum(item.file_size for item in archive.infolist()), max_bytes)
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        cells = unpacked_bound(path.stat().st_size, max_bytes) // BYTES_A_CELL
        sheets: dict[str, list[str]] = {}
        for sheet in book.worksheets:
            sheet._get_source = functools.partial(_rows_alone, sheet._get_source)
            sheets[sheet.title] = []
            for row in sheet.iter_rows(values_only=True):
                cells -= len(row) + 1
                if cells < 0:
                    raise RecordError(
                        f"{path.name} states more cells than its size explains: one of them "
                        "stands far from the others, or it was made to fill memory. Delete "
                        "the rows and columns without values, and save it again."
                    )
                sheets[sheet.title].append("\t".join(_fields(row)))
        book.close()
    except RecordError:
        raise
    except Exception as error:  # whatever unpacking and parsing raise
        raise unreadable(path, error) from error
    full = {name: lines for name, lines in sheets.items() if any(map(str.strip, lines))}
    if not full:
        raise RecordError(f"{path.name} has no sheet with anything in it. Give another file.")
    name = max(full, key=lambda name: sum(map(len, full[name])))
    others = ", ".join(other for other in full if other != name)
    notes = (f"Of {path.name} the sheet {name!r} was read, not {others}.",) * bool(others)
    return full[name], notes


def _rows_alone(source: Callable[[], BinaryIO]) -> BinaryIO:
    """Open the XML of a sheet up to the end of its rows.

    What follows them, such as a million merged cells, takes longer to read than they do.
    """
    return io.BufferedReader(_UpToRows(source()))


class _UpToRows(io.RawIOBase):
    def __init__(self, source: BinaryIO) -> None:
        self._source, self._held, self._ended = source, b"", False

    def readable(self) -> bool:
        return True

    def readinto(self, into: Any) -> int:
        while not self._ended and len(self._held) <= _MARK_BYTES:
            more = self._source.read(_BLOCK_BYTES)
            self._held += more
            mark = _END_OF_ROWS.search(self._held)
            if mark is not None:
                self._held = self._held[: mark.end()] + b"</" + (mark[1] or b"") + b"worksheet>"
            self._ended = mark is not None or not more
        # An end may be cut in two between blocks: its first bytes are held back.
        ready = len(self._held) - (0 if self._ended else _MARK_BYTES)
        count = min(len(into), ready)
        into[:count], self._held = self._held[:count], self._held[count:]
        return count


def _fields(row: Iterable[Any]) -> list[str]:
    fields = [_text(value) for value in row]
    while fields and not fields[-1]:
        fields.pop()
    return fields


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime.datetime):
        return value.isoformat(sep=" ", timespec="microseconds")
    if isinstance(value, datetime.time):
        return value.isoformat(timespec="microseconds")
    if isinstance(value, float):
        return repr(value)
    return str(value).replace("\t", " ").replace("\n", " ")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
