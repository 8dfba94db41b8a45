"""Conversion of a file of any kind to a sheet."""

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from .binary import workbook
from .binary.numpy_arrays import Arrays, as_double, read_npy, read_npz
from .binary.reader_process import read_matlab
from .channels import wrapped_rows
from .headings.sampling import Fact, Facts
from .readers import reader_of
from .reading_options import DateOrder
from .record import RecordError, Values
from .sheet import Column, Sheet
from .text_sheet import read_lines, read_text
from .times.stamps import Stamps

_ARRAYS = {".npy": read_npy, ".npz": read_npz, ".mat": read_matlab}
QUANTUM_STEPS = 1000
"""Steps of which the smallest common one is the resolution of stamps [1]."""
_RATE_NAMES = frozenset(
    "rate ratehz fs fshz samplerate sampleratehz samplingrate samplingratehz samplefrequency "
    "samplefrequencyhz samplingfrequency samplingfrequencyhz samplingfreq samplefreq sr".split()
)
_INTERVAL_NAMES = frozenset(
    "dt dts deltat sampleinterval samplinginterval sampletime sampleperiod samplingperiod ts "
    "tsample".split()
)
"""Names of numbers that state the rate or the interval, without the marks ``_``."""


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
        for k, array in {**arrays, **_numbers_in_texts(arrays)}.items()
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
    other = [
        k
        for k, array in tables.items()
        if max(array.shape) != length and not _states_sampling(k)
    ]
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
    columns = [*_stamped(arrays, length), *columns]
    return Sheet(
        columns=tuple(columns), named=True, facts=_facts_of(aux), aux=aux, notes=left_out
    )


def _numbers_in_texts(arrays: Arrays) -> dict[str, Values]:
    """Rates and intervals that are written as texts, such as ``fs = '200'``."""
    found: dict[str, Values] = {}
    for name, array in arrays.items():
        if array.dtype.kind in "US" and array.size == 1 and _states_sampling(name):
            with contextlib.suppress(ValueError):
                found[name] = np.asarray(float(array.reshape(-1)[0]))
    return found


def _states_sampling(name: str) -> bool:
    return _bare(name) in _RATE_NAMES | _INTERVAL_NAMES


def _bare(name: str) -> str:
    return name.rpartition(".")[2].casefold().replace("_", "")


def _stamped(arrays: Arrays, length: int) -> Iterator[Column]:
    """Columns of dates and times of NumPy, as long as the others."""
    for name, array in arrays.items():
        if array.dtype.kind == "M" and array.size == length and not np.isnat(array).any():
            ns = array.reshape(-1).astype("datetime64[ns]").astype(np.int64)
            steps = np.diff(ns)
            steps = steps[steps > 0]
            quantum = int(np.gcd.reduce(steps[:QUANTUM_STEPS])) if len(steps) else 1
            yield Column(name, "", ns, "stamp", Stamps(ns, True, True, max(quantum, 1)))


def _facts_of(aux: Arrays) -> Facts:
    """Find the rate or interval that a number states by its name; or several equal ones."""
    found = []
    for name, value in aux.items():
        numbers = np.unique(np.asarray(value, dtype=float))
        if not _states_sampling(name) or len(numbers) != 1 or not 0 < numbers[0] < np.inf:
            continue
        bare, number = name.rpartition(".")[2].casefold(), float(numbers[0])
        if _bare(name) in _RATE_NAMES:
            unit = bare.endswith("hz")
            found.append(Fact("rate", (number,), f"{name} = {number:g}", 0, exact=unit))
        else:
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
