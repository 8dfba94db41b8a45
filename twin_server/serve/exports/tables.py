"""Writes a history as CSV or Parquet page by page, in the memory of one page.

One row a state, in order. Numbers are written so that they read back to the last bit; what is
not estimated is empty in CSV and null in Parquet.
"""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool
from pydantic_core import from_json

from twin_server.history.states import ESTIMATES, USED_SMOOTHED, States, assumed, sentences
from twin_server.registration.twin import Registration
from twin_server.serve.instants import Moment
from twin_server.serve.knowledge import HistoryPart, Knowledge

Format = Literal["csv", "parquet"]
Table = Mapping[str, list[Any]]

PAGE = 5_000
"""States that are read, turned and written at once."""


class TableColumn(NamedTuple):
    """Content of a column; of an element, its name and the part of its estimate."""

    kind: str
    element: str = ""
    part: str = ""


_PARTS = {"": "value", "_sd": "sd", "_lo": "lo", "_hi": "hi"}
_KINDS = {
    "t_ns": "int64",
    "time": "timestamp",
    "slow_time": "double",
    "slow_time_unit": "string",
    "boot": "string",
    "sequence": "int64",
    "missing_before": "int64",
    "valid": "bool",
    "reasons": "string",
    "assumed": "string",
    "frequency_used": "string",
    "correlation": "double",
}


class NotInstalledError(ImportError):
    """A library that the format needs is not installed."""


def columns_of(registration: Registration) -> dict[str, TableColumn]:
    """Columns by name; of a twin of elements, those of each element after the rest."""
    elements = registration.structure().free if registration.changes == "elements" else ()
    return (
        {name: TableColumn(kind) for name, kind in _KINDS.items()}
        | {name + end: TableColumn("double") for name in ESTIMATES for end in _PARTS}
        | {
            f"elements.{name}{end}": TableColumn("double", name, part)
            for name in elements
            for end, part in _PARTS.items()
        }
    )


def pages_of(
    knowledge: Knowledge,
    twin_id: str,
    start: Moment | None = None,
    end: Moment | None = None,
) -> Iterator[HistoryPart]:
    """States from `start` to `end`, both included, a page at a time."""
    key = -1
    while True:
        page = knowledge.since(twin_id, key, PAGE)
        if not len(page.states):
            return
        key = page.keys[-1]
        kept = np.flatnonzero(_within(page.states, start, end))
        if len(kept):
            yield _rows(page, kept.tolist())


def written(
    pages: Iterable[HistoryPart], columns: Mapping[str, TableColumn], form: Format, twin_id: str
) -> Iterator[bytes]:
    """Bytes of the table, as they become ready.

    Raises
    ------
    NotInstalledError
        At once, where Parquet is asked for and pyarrow is not installed.
    """
    write = {"csv": _csv, "parquet": _parquet}[form]
    return write((_table(page, columns) for page in pages), columns, twin_id)


def _within(
    states: States, start: Moment | None, end: Moment | None
) -> Bool[np.ndarray, " state"]:
    inside = np.ones(len(states), bool)
    for moment, compare in ((start, np.greater_equal), (end, np.less_equal)):
        if moment is not None and moment.t_ns is not None:
            inside &= compare(states["t_ns"], moment.t_ns)
        if moment is not None and moment.slow_time is not None:
            inside &= compare(states["slow_time"], moment.slow_time)
    return inside


def _rows(page: HistoryPart, kept: list[int]) -> HistoryPart:
    return HistoryPart(
        page.states[kept],
        [page.keys[row] for row in kept],
        [page.boots[row] for row in kept],
        [page.units[row] for row in kept],
        [page.bodies[row] for row in kept] if page.bodies else (),
    )


def _table(page: HistoryPart, columns: Mapping[str, TableColumn]) -> Table:
    states = page.states
    reasons, notes = states["reasons"].tolist(), states["notes"].tolist()
    said = {bits: " ".join(sentences(bits)) for bits in {*reasons}}
    table: dict[str, list[Any]] = {
        "t_ns": states["t_ns"].tolist(),
        "time": states["t_ns"].tolist(),  # nanoseconds are what Arrow takes
        "slow_time": states["slow_time"].tolist(),
        "slow_time_unit": list(page.units),
        "boot": list(page.boots),
        "sequence": states["sequence"].tolist(),
        "missing_before": states["missing_before"].tolist(),
        "valid": [not bits for bits in reasons],
        "reasons": [said[bits] for bits in reasons],
        "assumed": [" ".join(assumed(bits)) for bits in notes],
        "frequency_used": ["smoothed" if b & USED_SMOOTHED else "measured" for b in notes],
        "correlation": _present(states["correlation"].tolist()),
    }
    for name in ESTIMATES:
        for number, end in enumerate(_PARTS):
            table[name + end] = _present(states[name][:, number].tolist())
    bodies = page.bodies or [None] * len(states)
    of_each = [{} if body is None else from_json(body)["elements"] for body in bodies]
    for name, (_, element, part) in columns.items():
        if element:
            table[name] = [one[element][part] if element in one else None for one in of_each]
    return table


def _present(values: list[float]) -> list[float | None]:
    return [None if value != value else value for value in values]


def _csv(
    tables: Iterable[Table], columns: Mapping[str, TableColumn], _: str
) -> Iterator[bytes]:
    text = io.StringIO()
    write = csv.writer(text)
    write.writerow(columns)
    for table in tables:
        moments = np.array(table["t_ns"], "datetime64[ns]")
        rfc3339 = {"time": [f"{one}Z" for one in np.datetime_as_string(moments).tolist()]}
        of_each: list[list[Any]] = [
            ["true" if value else "false" for value in table[name]]
            if kind == "bool"
            else (rfc3339.get(name) or table[name])
            for name, (kind, _, _) in columns.items()
        ]
        write.writerows(zip(*of_each, strict=True))
        yield text.getvalue().encode()
        text.seek(0)
        text.truncate()
    yield text.getvalue().encode()


def _parquet(
    tables: Iterable[Table], columns: Mapping[str, TableColumn], twin_id: str
) -> Iterator[bytes]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise NotInstalledError(
            "Parquet needs pyarrow, which is not installed. Install it with `pip install "
            "'slowtime[parquet]'`, or take CSV."
        ) from error
    types: dict[str, Callable[[], Any]] = {
        "int64": pyarrow.int64,
        "double": pyarrow.float64,
        "string": pyarrow.string,
        "bool": pyarrow.bool_,
        "timestamp": lambda: pyarrow.timestamp("ns", "UTC"),
    }
    schema = pyarrow.schema(
        [(name, types[kind]()) for name, (kind, _, _) in columns.items()],
        metadata={"slowtime.twin": twin_id},
    )

    def bytes_of() -> Iterator[bytes]:
        sink = _Sink()
        with pyarrow.parquet.ParquetWriter(sink, schema, compression="zstd") as writer:
            for table in tables:
                writer.write_table(pyarrow.table(dict(table), schema))
                yield sink.taken()
        yield sink.taken()

    return bytes_of()


class _Sink(io.RawIOBase):
    """A file that is only ever written on, and taken from before it is whole."""

    def __init__(self) -> None:
        self._waiting, self._written = bytearray(), 0

    def writable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._written

    def write(self, given: Any) -> int:
        piece = bytes(given)
        self._waiting += piece
        self._written += len(piece)
        return len(piece)

    def taken(self) -> bytes:
        """Return the bytes written since the last call."""
        piece = bytes(self._waiting)
        self._waiting.clear()
        return piece
