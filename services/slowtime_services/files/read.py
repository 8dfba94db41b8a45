"""One door for every kind of file: find the clock, choose the channels, say what was found."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from .apart import read_matlab
from .arrays import Arrays, read_npy, read_npz
from .record import Gap, Record, RecordError, Values, find_column, in_sensor_type
from .text import read_table
from .timeaxis import TimeAxis, is_time_name, looks_like_time, read_time

Column = Shaped[np.ndarray, " time"]
MAX_BYTES = 1 << 30
SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e9
"""Sampling rates beyond these are taken for slips of the pen."""
_ARRAYS = {".npy": read_npy, ".npz": read_npz, ".mat": read_matlab}
_RATE_NAMES = frozenset(
    "rate_hz rate fs f_s samplerate sample_rate sampling_rate samplingrate sampling_frequency "
    "samplingfrequency fs_hz sr".split()
)


def read_record(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    channels: Sequence[str] | None = None,
    skip_lines: int | None = None,
    columns: Sequence[str] | None = None,
    time_column: str | None = None,
    keep_missing: bool = False,
    max_bytes: int = MAX_BYTES,
) -> Record:
    """Read a record of measurements from a file.

    Text of any delimiter (comma, tab, semicolon, bar, blanks; decimal point or comma), with
    or without preamble, header, units and time column; NumPy ``.npy`` and ``.npz``; MATLAB
    ``.mat`` of version 5 and of version 7.3. Arrays may lie either way: the longer side is
    time.

    Parameters
    ----------
    rate_hz
        Samples per second; None to find it in a time column, in a variable such as ``fs``,
        or in the preamble. If given, it overrules them.
    channels
        Names, or numbers from 0, of the columns to keep as samples; None for all but the clock.
        Other columns go to `Record.aux`.
    skip_lines
        Lines of text before the first row of numbers; None to find out.
    columns
        Names of the columns, in order; None to take those in the file.
    time_column
        Name or number of the column that holds the clock; ``"none"`` if there is none; None to
        find out.
    keep_missing
        Whether NaN and empty fields are kept, as NaN, instead of refused.
    max_bytes
        What a file may hold at most.

    Raises
    ------
    RecordError
        (a ValueError) where the file is no record; the text says what to do. OSError where it
        cannot be opened.
    """
    path = Path(path)
    if rate_hz is not None:
        _refuse_rate(rate_hz)
    size = path.stat().st_size
    if size > max_bytes:
        raise RecordError(
            f"{path.name} has {size / 2**20:.0f} MiB; at most {max_bytes / 2**20:.0f} MiB "
            "are read at once. Cut it into several files, or raise max_bytes."
        )
    table = _open(path, skip_lines, keep_missing, max_bytes)
    names, values = _names(table.names, columns, len(table.values)), table.values
    _refuse_unusable(values, names, path.name, keep_missing)
    clock = _find_clock(names, values, time_column)
    axis, notes = _time_axis(clock, names, table, rate_hz)
    rate = rate_hz or (axis.rate_hz if axis else table.stated_rate_hz)
    if rate is None:
        raise RecordError(
            f"{path.name} does not say how often it was sampled: {_no_clock(names, values)}. "
            "Give --rate-hz, or name the clock with --time-column."
        )
    _refuse_rate(rate)
    kept = _kept(names, channels, clock)
    if not kept:
        raise RecordError(
            f"{path.name} has no channel beside its clock. Give a file with samples."
        )
    others = {name: values[i] for i, name in enumerate(names) if i not in kept}
    return Record(
        samples=in_sensor_type(np.column_stack([values[i] for i in kept])),
        rate_hz=float(rate),
        channels=tuple(names[i] for i in kept),
        units=tuple(table.units[i] for i in kept),
        start_ns=axis.start_ns if axis else None,
        gaps=axis.gaps if axis else (),
        aux={**table.aux, **others},
        notes=notes,
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Columns:
    """What every kind of file is brought to."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[Column, ...]
    stated_rate_hz: float | None
    aux: Arrays
    notes: tuple[str, ...]
    first_line: int


def _open(path: Path, skip_lines: int | None, keep_missing: bool, max_bytes: int) -> _Columns:
    kind = path.suffix.lower()
    if kind == ".mcap":
        raise RecordError(
            f"{path.name} is a recording, not a table. Read it with `slowtime replay`."
        )
    if kind in _ARRAYS:
        return _columns(_ARRAYS[kind](path, max_bytes), path.name)
    text = read_table(path, skip_lines=skip_lines, keep_missing=keep_missing)
    return _Columns(
        text.names,
        text.units,
        tuple(text.values.T),
        text.stated_rate_hz,
        {},
        text.notes,
        text.first_line,
    )


def _columns(arrays: Arrays, file: str) -> _Columns:
    """Arrays of one common length as columns; single numbers and other lengths apart."""
    plain = {k: np.squeeze(array) for k, array in arrays.items() if array.dtype.kind in "fiub"}
    tables = {k: array for k, array in plain.items() if array.ndim in (1, 2) and array.size > 1}
    if not tables:
        shapes = ", ".join(f"{k} {array.shape} {array.dtype}" for k, array in arrays.items())
        raise RecordError(
            f"{file} holds no series of real numbers, but: {shapes or 'nothing'}. Give one "
            "array per channel, plus t or rate_hz."
        )
    length = max(max(array.shape) for array in tables.values())
    columns: dict[str, Column] = {}
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
        columns.update(zip(named, table.T, strict=True))
    unreal = [k for k, array in arrays.items() if array.dtype.kind == "c"]
    left_out = (f"Left out, not being of length {length}: {', '.join(other)}.",) * bool(other)
    left_out += (f"Left out, holding complex numbers: {', '.join(unreal)}.",) * bool(unreal)
    stated = [float(v) for k, v in aux.items() if v.ndim == 0 and _bare(k) in _RATE_NAMES]
    return _Columns(
        tuple(columns),
        ("",) * len(columns),
        tuple(columns.values()),
        stated[0] if stated else None,
        aux,
        left_out,
        0,
    )


def _bare(name: str) -> str:
    return name.rpartition(".")[2].casefold()


def _names(found: tuple[str, ...], given: Sequence[str] | None, width: int) -> tuple[str, ...]:
    if given is not None and len(given) != width:
        raise RecordError(
            f"{len(given)} column names were given, {', '.join(given)}, for {width} columns. "
            "Give one name for each, the time column's included."
        )
    names = tuple(given) if given is not None else found
    if not names:
        return tuple(f"channel_{i}" for i in range(width))
    return tuple(
        name if names.count(name) == 1 else f"{name}_{i}" for i, name in enumerate(names)
    )


def _refuse_unusable(
    values: Sequence[Column],
    names: tuple[str, ...],
    file: str,
    keep_missing: bool,
) -> None:
    if len(values[0]) < 2:
        raise RecordError(f"{file} has a single row. Give a record of at least two.")
    if keep_missing:
        return
    for name, column in zip(names, values, strict=True):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise RecordError(
                f"{file}, column {name}: {bad.size} values are not finite, the first in row "
                f"{bad[0]}. Cut them out or fill them in; the edge agent can be told to treat "
                "them as dropouts."
            )


def _refuse_rate(rate_hz: float) -> None:
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise RecordError(
            f"{rate_hz:g} is not a sampling rate. Give samples per second, from {SLOWEST_HZ:g} "
            f"to {FASTEST_HZ:g}."
        )


def _find_clock(
    names: tuple[str, ...], values: Sequence[Column], given: str | None
) -> int | None:
    """Which column is the clock: the one named, else by name, else by its constant step."""
    if given is not None:
        return None if given.casefold() == "none" else find_column(given, names)
    rising = [i for i, v in enumerate(values) if v.dtype.kind in "fiu" and _rises(v)]
    named = [i for i in rising if is_time_name(names[i])]
    steady = [i for i in rising if len(values) > 1 and looks_like_time(values[i].astype(float))]
    return next(iter(named + steady), None)


def _no_clock(names: tuple[str, ...], values: Sequence[Column]) -> str:
    """Say why no column passes for a clock."""
    for name, column in zip(names, values, strict=True):
        if is_time_name(name):
            back = int(np.sum(~(np.diff(column.astype(float)) > 0)))
            return (
                f"column {name!r} does not run forwards in {back} of {len(column) - 1} steps, "
                "and is no clock as it stands. Sort the rows by time if they are out of order"
            )
    return f"no time column was found among {', '.join(names)}"


def _rises(values: Column) -> bool:
    return bool(values[-1] > values[0]) and bool(
        (np.diff(values.astype(float)) > 0).mean() > 0.5
    )


def _time_axis(
    clock: int | None, names: tuple[str, ...], table: _Columns, rate_hz: float | None
) -> tuple[TimeAxis | None, tuple[str, ...]]:
    """Read the clock; a rate that was given overrules it."""
    notes = table.notes
    if clock is None:
        return None, notes
    name, unit = names[clock], table.units[clock]
    try:
        axis = read_time(table.values[clock], name=name, unit=unit, first_line=table.first_line)
    except RecordError as error:
        if rate_hz is None:
            raise
        return None, (*notes, f"The clock was not used, since a rate was given: {error}")
    if rate_hz is not None and abs(axis.rate_hz / rate_hz - 1) > 1e-3:
        said = f"Column {name!r} says {axis.rate_hz:g} Hz; {rate_hz:g} Hz was given, and used."
        return dataclasses.replace(axis, rate_hz=rate_hz, gaps=()), (*notes, said)
    if axis.gaps:
        notes = (*notes, _say_gaps(axis.gaps))
    if axis.jitter > 0.05:
        notes = (*notes, f"The clock jitters by {100 * axis.jitter:.0f} % of a step (rms).")
    return axis, notes


def _say_gaps(gaps: tuple[Gap, ...]) -> str:
    missing = sum(gap.missing for gap in gaps)
    samples = "1 sample is" if missing == 1 else f"{missing} samples are"
    where = "1 gap," if len(gaps) == 1 else f"{len(gaps)} gaps, the first"
    return f"{samples} missing in {where} before row {gaps[0].row}."


def _kept(
    names: tuple[str, ...], channels: Sequence[str] | None, clock: int | None
) -> tuple[int, ...]:
    if channels is None:
        return tuple(i for i in range(len(names)) if i != clock)
    kept = tuple(find_column(name, names) for name in channels)
    if clock in kept:
        raise RecordError(
            f"{names[clock]!r} is the clock of the record, not a channel. Leave it out; if "
            "it is one after all, give --time-column none and --rate-hz."
        )
    if len(set(kept)) != len(kept):
        raise RecordError(
            f"A channel was named twice in {', '.join(channels)}. Name each once."
        )
    return kept
