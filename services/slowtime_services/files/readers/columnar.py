"""Parquet, Arrow and Feather files, by pyarrow."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet

from slowtime_services.files.binary.numpy_arrays import refuse_above

from .found import Found, Series


def read(path: Path, max_bytes: int) -> Found:
    """Return each column of numbers, and those of times as stamps; nulls are NaN."""
    # Threads take memory each, which a file of this size does not need.
    pa.set_cpu_count(1)
    with path.open("rb") as file:
        parquet = file.read(4) == b"PAR1"
    if parquet:
        with pyarrow.parquet.ParquetFile(path) as columns:
            wanted, left_out = _numeric(columns.schema_arrow)
            refuse_above(path, 8 * columns.metadata.num_rows * len(wanted), max_bytes)
            table = columns.read(columns=wanted)
    else:
        table = pyarrow.feather.read_table(path, memory_map=False)
        wanted, left_out = _numeric(table.schema)
        table = table.select(wanted)
    stated = _rate((table.schema.metadata or {}).get(b"rate_hz"))
    series: list[Series] = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        unit = ((table.field(name).metadata or {}).get(b"unit") or b"").decode(errors="replace")
        kind = column.type
        if pa.types.is_timestamp(kind) and not column.null_count:
            stamps = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy()
            series.append(Series(name, stamps, stamps=True))
        elif pa.types.is_integer(kind) and not column.null_count:
            series.append(Series(name, column.to_numpy(), unit))
        elif not pa.types.is_timestamp(kind):
            values = np.asarray(column.to_numpy(), dtype=float if column.null_count else None)
            series.append(Series(name, values, unit))
        else:
            left_out.append(name)
    series = [
        Series(one.name, one.values, one.unit, stated, None, one.stamps) for one in series
    ]
    said = (f"Left out, without numbers: {', '.join(left_out[:8])}.",) * bool(left_out)
    return Found(series, said)


def _numeric(schema: pa.Schema) -> tuple[list[str], list[str]]:
    """Names of the columns of numbers and times, and of the others, which are not read."""
    kinds = (pa.types.is_floating, pa.types.is_integer, pa.types.is_timestamp)
    wanted = [one.name for one in schema if any(holds(one.type) for holds in kinds)]
    return wanted, [name for name in schema.names if name not in wanted]


def _rate(text: bytes | None) -> float | None:
    """Read the rate that slowtime writes among the metadata of a schema."""
    try:
        rate = float(text or b"")
    except ValueError:
        return None
    return rate if 0.0 < rate < 1e12 else None
