"""Conversion of a file of any kind to a sheet."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .binary import workbook
from .binary.numpy_arrays import Arrays, as_double, read_npy, read_npz
from .binary.reader_process import read_matlab
from .channels import wrapped_rows
from .headings.sampling import Fact, Facts
from .readers import reader_of
from .record import RecordError, Values
from .sheet import Column, Sheet
from .text_sheet import read_lines, read_text
from .times.stamps import DateOrder

_ARRAYS = {".npy": read_npy, ".npz": read_npz, ".mat": read_matlab}
_RATE_NAMES = frozenset(
    "rate_hz rate fs f_s samplerate sample_rate sampling_rate samplingrate sampling_frequency "
    "samplingfrequency fs_hz sr".split()
)
_INTERVAL_NAMES = frozenset("dt delta_t sample_interval sampling_interval dt_s".split())


def open_sheet(
    path: Path,
    skip_lines: int | None,
    max_bytes: int,
    date_order: DateOrder | None,
    wanted: tuple[str, ...] | None,
) -> Sheet:
    """Read the columns of a file by its ending, else by its first bytes."""
    kind = path.suffix.lower()
    if kind in _ARRAYS:
        return _sheet(_ARRAYS[kind](path, max_bytes), path.name)
    if kind in workbook.SUFFIXES:
        lines, notes = workbook.lines_of(path, max_bytes)
        sheet = read_lines(lines, path.name, skip_lines, date_order)
        return dataclasses.replace(sheet, notes=(*sheet.notes, *notes))
    if (reader := reader_of(path)) is not None:
        return reader.open(path, max_bytes, wanted)
    return read_text(path, skip_lines=skip_lines, date_order=date_order)


def _sheet(arrays: Arrays, file: str) -> Sheet:
    """Collect arrays of one common length as columns; other lengths are kept apart."""
    plain = {
        k: as_double(np.squeeze(array))
        for k, array in arrays.items()
        if array.dtype.kind in "fiub"
    }
    tables = {k: array for k, array in plain.items() if array.ndim in (1, 2) and array.size > 1}
    if not tables:
        shapes = ", ".join(f"{k} {array.shape} {array.dtype}" for k, array in arrays.items())
        raise RecordError(
            f"{file} holds no series of real numbers, but: {shapes or 'nothing'}. Give one "
            "array per channel, plus t or rate_hz."
        )
    length = max(max(array.shape) for array in tables.values())
    columns: list[Column] = []
    aux: dict[str, Values] = {}
    other = [k for k, array in tables.items() if max(array.shape) != length]
    for name, array in plain.items():
        if name not in tables or max(array.shape) != length:
            aux[name] = array
            continue
        table = array[:, None] if array.ndim == 1 else array
        table = table if table.shape[0] == length else table.T
        width = table.shape[1]
        named = [name] if width == 1 else [f"{name}_{i}" for i in range(width)]
        columns.extend(Column(n, "", v) for n, v in zip(named, table.T, strict=True))
    unreal = [k for k, array in arrays.items() if array.dtype.kind == "c"]
    left_out = (f"Left out, not being of length {length}: {', '.join(other)}.",) * bool(other)
    left_out += (f"Left out, holding complex numbers: {', '.join(unreal)}.",) * bool(unreal)
    return Sheet(
        columns=tuple(columns), named=True, facts=_facts_of(aux), aux=aux, notes=left_out
    )


def _facts_of(aux: Arrays) -> Facts:
    """Find the rate or interval that a single number states by its name."""
    found = []
    for name, value in aux.items():
        if value.ndim or not np.isfinite(value) or not value > 0:
            continue
        bare, number = name.rpartition(".")[2].casefold(), float(value)
        if bare in _RATE_NAMES:
            unit = bare.endswith("hz")
            found.append(Fact("rate", (number,), f"{name} = {number:g}", 0, exact=unit))
        elif bare in _INTERVAL_NAMES:
            unit = bare.endswith("_s")
            found.append(Fact("interval", (number,), f"{name} = {number:g}", 0, exact=unit))
    return Facts(tuple(found))


def renamed(sheet: Sheet, given: Sequence[str] | None) -> Sheet:
    """Rename columns as given."""
    if given is None:
        return sheet
    width = len(sheet.columns)
    if len(given) != width:
        raise RecordError(
            f"{len(given)} column names were given, {', '.join(given)}, for {width} columns. "
            "Give one name for each, the time column's included."
        )
    columns = (
        dataclasses.replace(column, name=name)
        for column, name in zip(sheet.columns, given, strict=True)
    )
    return dataclasses.replace(sheet, columns=tuple(columns), named=True)


def pairs_unwrapped(sheet: Sheet) -> Sheet:
    """Bring pairs of time and value, several a line, into two columns."""
    if sheet.named or any(c.kind != "number" for c in sheet.columns) or len(sheet.columns) < 4:
        return sheet
    table = np.column_stack([c.values for c in sheet.columns])
    pairs = wrapped_rows.pairs_of_time_and_value(table.astype(float), sheet.tail)
    if pairs is None:
        return sheet
    time, value = Column("time", "", pairs[:, 0]), Column("channel_1", "", pairs[:, 1])
    said = f"pairs of time and value, {len(sheet.columns) // 2} on a line"
    return dataclasses.replace(
        sheet,
        columns=(time, value),
        named=True,
        tail=(),
        assumptions=(*sheet.assumptions, said),
        notes=tuple(note for note in sheet.notes if "cut short" not in note),
    )
