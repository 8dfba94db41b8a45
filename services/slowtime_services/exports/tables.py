"""A record as a table: a clock, and a column for each channel with its unit."""

import csv
import importlib.util
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from slowtime_services.files import Record, RecordError

ROWS = 50_000
"""Rows that are turned and written at once."""
CLOCK, SECONDS = "time", "t"
"""Names of a clock that tells the date, and of one that counts from the first row."""


def write_csv(path: Path, record: Record) -> None:
    """Write ``name [unit]`` in a heading of one line, then a row an instant.

    The clock is in nanoseconds of UTC where the record has a start, else in seconds from its
    first row; samples that are missing show in it. Numbers have all their digits.
    """
    clock = f"{SECONDS} [s]" if record.start_ns is None else CLOCK
    heads = [
        f"{name} [{unit}]" if unit else name
        for name, unit in zip(record.channels, record.units, strict=True)
    ]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([clock, *heads])
        for first, late in _parts(record):
            instants = first + late + np.arange(min(ROWS, _end(record, first) - first))
            rows = record.samples[first : first + len(instants)].tolist()
            for told, row in zip(_row_values(record, instants), rows, strict=True):
                table.writerow([told, *row])


def write_parquet(path: Path, record: Record) -> None:
    """Write a column a channel, its unit among the metadata of its field; needs pyarrow.

    Raises
    ------
    RecordError
        Where pyarrow is missing.
    """
    if importlib.util.find_spec("pyarrow") is None:
        raise RecordError(
            "Parquet is written by pyarrow. Install it: pip install 'slowtime[parquet]' or "
            "pip install pyarrow. Or write .csv."
        )
    import pyarrow as pa
    import pyarrow.parquet

    dated = record.start_ns is not None
    clock = pa.field(CLOCK, pa.timestamp("ns", "UTC")) if dated else pa.field(
        SECONDS, pa.float64(), metadata={"unit": "s"}
    )  # fmt: skip
    kind = pa.from_numpy_dtype(record.samples.dtype)
    fields = [
        pa.field(name, kind, metadata={"unit": unit})
        for name, unit in zip(record.channels, record.units, strict=True)
    ]
    schema = pa.schema([clock, *fields], metadata={"rate_hz": repr(float(record.rate_hz))})
    with pyarrow.parquet.ParquetWriter(path, schema) as writer:
        for first, late in _parts(record):
            instants = first + late + np.arange(min(ROWS, _end(record, first) - first))
            rows = record.samples[first : first + len(instants)]
            times = (
                pa.array(_nanoseconds(record, instants), pa.timestamp("ns", "UTC"))
                if dated
                else pa.array(_seconds(record, instants))
            )
            columns = [pa.array(np.ascontiguousarray(column)) for column in rows.T]
            writer.write_table(pa.table([times, *columns], schema=schema))


def _parts(record: Record) -> Iterator[tuple[int, int]]:
    """First row of each part, and samples that are missing before it."""
    edges = [0, *(gap.row for gap in record.gaps), len(record.samples)]
    late = 0
    for number, (first, last) in enumerate(itertools.pairwise(edges)):
        late += record.gaps[number - 1].missing if number else 0
        for row in range(first, last, ROWS):
            yield row, late


def _end(record: Record, first: int) -> int:
    """Row after the last of the part without a gap in which `first` is."""
    return min((gap.row for gap in record.gaps if gap.row > first), default=len(record.samples))


def _seconds(record: Record, instants: Int[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    return instants / record.rate_hz


def _nanoseconds(record: Record, instants: Int[np.ndarray, " row"]) -> Int[np.ndarray, " row"]:
    start = record.start_ns
    assert start is not None
    whole, rest = np.divmod(instants, max(round(record.rate_hz), 1))
    if record.rate_hz == round(record.rate_hz):
        ns = whole * 10**9 + np.round(rest * (1e9 / record.rate_hz)).astype(np.int64)
    else:
        ns = np.round(instants * (1e9 / record.rate_hz)).astype(np.int64)
    return np.asarray(start + ns)


def _row_values(record: Record, instants: Int[np.ndarray, " row"]) -> list[Any]:
    if record.start_ns is None:
        return list(_seconds(record, instants).tolist())
    stamps = _nanoseconds(record, instants).astype("datetime64[ns]")
    return [f"{stamp}Z" for stamp in np.datetime_as_string(stamps)]
