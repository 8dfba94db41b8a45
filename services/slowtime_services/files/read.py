"""One door for every kind of file: find the clock, choose the channels, hold both to account.

The stages: a file becomes a `Sheet` of columns with names, units and the figures of its
heading; its clock is told apart (`clock`), then what is no channel (`roles`); what remains is
held against the heading (`plausibility`), which also decides whether columns are channels or
one series. What was taken for granted on the way stands in the record.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import clock, plausibility, roles, workbook, wrapping
from .apart import read_matlab
from .arrays import Arrays, as_double, read_npy, read_npz
from .conversion import in_si
from .facts import Fact, Facts
from .readers import reader_of
from .record import (
    NAMES_SLOW,
    Gap,
    Record,
    RecordError,
    Values,
    find_column,
    in_sensor_type,
)
from .sheet import Column, Sheet
from .stamps import DateOrder
from .text import read_lines, read_text
from .time_units import UNITS, is_time_name
from .timeaxis import TimeAxis, UnevenError, unwrapped

MAX_BYTES = 1 << 30
SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e9
"""Sampling rates that a person may give; beyond these they are slips of the pen."""
ALL = "all"
BY_CLOCK = "time from column"
"""Begins the assumption of a record whose clock is one of its columns."""
FAR_S, FAR = 1.0, 0.01
"""Time of the first row, in seconds and in lengths of the record, beyond which a clock is not
counted from the start that a heading states."""
LONGEST_PERIOD = 64
"""Sensors of which the rows of a file may be in turn."""
MOST_MISSING = 0.2
"""Share of rows that may lack a value and be left out; beyond it, the file is to be mended."""
_ARRAYS = {".npy": read_npy, ".npz": read_npz, ".mat": read_matlab}
_RATE_NAMES = frozenset(
    "rate_hz rate fs f_s samplerate sample_rate sampling_rate samplingrate sampling_frequency "
    "samplingfrequency fs_hz sr".split()
)
_INTERVAL_NAMES = frozenset("dt delta_t sample_interval sampling_interval dt_s".split())


# Values of a damaged file may be so large that their squares are infinite: a pattern that
# is looked for is then not there, and what stands in the file is kept.
@np.errstate(over="ignore", invalid="ignore")
def read_record(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    channels: Sequence[str] | None = None,
    skip_lines: int | None = None,
    columns: Sequence[str] | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    date_order: DateOrder | None = None,
    wrapped: bool | None = None,
    keep: Sequence[str] = (),
    keep_missing: bool = False,
    skip_missing: bool = False,
    units: Sequence[str] = (),
    sensitivities: Sequence[str] = (),
    max_bytes: int = MAX_BYTES,
    of_a_piece: bool = False,
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
        or in the heading. If given, it overrules them.
    channels
        Names, or numbers from 0, of the columns to keep as samples; None for all but clocks,
        counters, magnitudes, constants and words. Other columns go to `Record.aux`.
    skip_lines
        Lines of text before the first row of numbers; None to find out.
    columns
        Names of the columns, in order; None to take those in the file.
    time_column
        Name or number of the column that holds the clock; ``"none"`` if there is none; None to
        find out.
    time_unit
        Unit of that column: s, ms, us, ns, min, h or d; None to find out.
    date_order
        Whether day (``"dmy"``) or month (``"mdy"``) comes first in dates with slashes.
    wrapped
        Whether all columns are one series, several values a line; None to find out.
    keep
        Columns to keep as channels that would be set aside; ``("all",)`` for each.
    keep_missing
        Whether NaN and empty fields are kept, as NaN, instead of refused.
    skip_missing
        Whether rows in which a value is missing are left out as gaps, instead of refused.
    units
        Units of the samples in the file, ``UNIT`` of all channels or ``CHANNEL=UNIT``; they
        overrule it.
    sensitivities
        What volts or counts mean: ``100mV/g``, ``CHANNEL=256LSB/g``.
    max_bytes
        What a file may hold at most.
    of_a_piece
        Whether it is a piece of a longer file, of which its heading states the number of
        points and the duration.

    Returns
    -------
    Samples in SI where their unit is one of motion, else as the file has them; see
    `slowtime_services.files.conversion`.

    Raises
    ------
    RecordError
        (a ValueError) where the file is no record, or may be read in several ways; the text
        says what to do. OSError where it cannot be opened.
    """
    path = Path(path)
    _refuse_slips(rate_hz, time_unit)
    size = path.stat().st_size
    if size > max_bytes:
        raise RecordError(
            f"{path.name} has {size / 2**20:.0f} MiB; at most {max_bytes / 2**20:.0f} MiB "
            "are read at once. Cut it into several files, or raise max_bytes."
        )
    said = _Said(rate_hz, channels, time_column, time_unit, wrapped, tuple(keep))
    missing = _Missing(keep_missing, skip_missing)
    chosen = None if channels is None else tuple(channels)
    sheet = _open(path, skip_lines, max_bytes, date_order, chosen)
    sheet = _renamed(sheet, columns)
    if of_a_piece:
        sheet = dataclasses.replace(sheet, facts=sheet.facts.of_any_length)
    if len(sheet.columns[0].values) < 2 and len(sheet.columns) + len(sheet.tail) < 2 + (
        sheet.facts.found == ()
    ) * len(sheet.columns):
        raise RecordError(f"{path.name} has a single row. Give a record of at least two.")
    record = _record(path.name, _pairs_unwrapped(sheet), said, missing)
    plausibility.refuse_beyond(path.name, record.rate_hz) if rate_hz is None else None
    return in_si(record, units, sensitivities)


def _pairs_unwrapped(sheet: Sheet) -> Sheet:
    """Bring pairs of time and value, several a line, into two columns."""
    if sheet.named or any(c.kind != "number" for c in sheet.columns) or len(sheet.columns) < 4:
        return sheet
    table = np.column_stack([c.values for c in sheet.columns])
    pairs = wrapping.pairs_of_time_and_value(table.astype(float), sheet.tail)
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


class _Said(NamedTuple):
    """What a person says of a file."""

    rate_hz: float | None
    channels: Sequence[str] | None
    time_column: str | None
    time_unit: str | None
    wrapped: bool | None
    keep: tuple[str, ...]


class _Missing(NamedTuple):
    """What to do with values that are missing."""

    keep: bool
    skip: bool


def _record(file: str, sheet: Sheet, said: _Said, missing: _Missing) -> Record:
    """Decide what the columns are, hold that to account, and gather the samples."""
    names = sheet.names
    told = _tell(sheet, said)
    kept, why = _kept(file, sheet, said, told.columns, sparse=not missing.keep)
    if said.rate_hz is None:
        _refuse_several_sensors(file, sheet)
    lost = _rows_missing(file, sheet, kept, missing)
    rows = np.arange(len(lost))[~lost]
    if missing.skip and lost.any():
        sheet = _only_rows(sheet, rows)
        told = _tell(sheet, said)
    axis, notes = _axis(told, said, sheet.facts)
    gaps = axis.gaps if axis is not None else ()
    if axis is None and missing.skip:
        gaps = tuple(_gaps_of(rows))
    if axis is None and not gaps:
        gaps, counted = _gaps_of_counter(sheet, why)
        notes += counted
    values = [sheet.columns[i].values for i in kept]
    measured = _measured(sheet, kept, said, axis, gaps, told)
    verdict = plausibility.judge(file, sheet.facts, measured)
    rate = verdict.rate_hz
    if rate is None:
        raise told.refusal or RecordError(
            f"{file} does not say how often it was sampled: {_no_clock(sheet)}. "
            "Give --rate-hz, or name the clock with --time-column."
        )
    if (
        said.rate_hz is None
        and told.clock is None
        and told.refusal is not None
        and told.columns
    ):
        notes += (f"The column of times was not used: {told.refusal}",)
    if verdict.wrapped:
        return _series(sheet, kept, verdict, notes)
    assumptions = (*sheet.assumptions, *_said_of(told, axis, why), *verdict.assumptions)
    others = {n: _plain(sheet.columns[i]) for i, n in enumerate(names) if i not in kept}
    start_ns, said_start = _start(sheet, axis, told)
    assumptions += said_start
    if lost.any():
        notes += (_say_missing(values, lost, missing),)
    if gaps:
        notes += (_say_gaps(gaps),)
    return Record(
        samples=in_sensor_type(_finite(np.column_stack(values))),
        rate_hz=float(rate),
        channels=tuple(names[i] for i in kept),
        units=tuple(_unit(sheet, i, kept) for i in kept),
        start_ns=start_ns,
        gaps=gaps,
        aux={**sheet.aux, **{k: v for k, v in others.items() if v.dtype.kind in "fiub"}},
        notes=(*sheet.notes, *notes, *verdict.notes),
        assumptions=assumptions,
    )


def _start(
    sheet: Sheet, axis: TimeAxis | None, told: clock.Told
) -> tuple[int | None, tuple[str, ...]]:
    """Give the start by the clock, else by the heading, and how the latter is said."""
    if axis is not None and axis.start_ns is not None:
        return axis.start_ns, ()
    if not sheet.start_said or sheet.start_ns is None:
        return sheet.start_ns, ()
    if told.clock is not None and axis is not None:
        late_s = abs(float(told.clock.values[0])) * told.clock.scale
        if late_s > FAR_S + FAR * len(told.clock.values) / axis.rate_hz:
            return None, ()  # counted from power-on or the like, of which the heading tells not
    return sheet.start_ns, (f"start by the heading ({sheet.start_said!r}), in UTC",)


def _unit(sheet: Sheet, place: int, kept: Sequence[int]) -> str:
    """Give the unit of a channel: its own, else the one that all samples have."""
    stated = sheet.columns[place].unit
    if stated or any(sheet.columns[i].unit for i in kept):
        return stated
    return "" if NAMES_SLOW.search(sheet.columns[place].name) else sheet.unit


def _plain(column: Column) -> Values:
    """Values of a column that is no channel; of stamps, seconds from the first."""
    if column.stamps is None:
        return column.values
    return np.asarray((column.values - column.values[0]) * 1e-9)


def _finite(samples: Values) -> Values:
    """Put NaN in place of what is infinite."""
    if samples.dtype.kind != "f" or not np.isinf(samples).any():
        return samples
    return np.where(np.isfinite(samples), samples, np.nan)


def _tell(sheet: Sheet, said: _Said) -> clock.Told:
    if said.wrapped:
        return clock.Told(None, None, frozenset())
    stated = {value for fact in sheet.facts.of("rate") for value in fact.values}
    stated |= {1 / value for fact in sheet.facts.of("interval") for value in fact.values}
    return clock.tell(
        sheet,
        sheet.names,
        said.time_column,
        unit=said.time_unit,
        stated_rate_hz=stated.pop() if len(stated) == 1 else None,
    )


def _series(
    sheet: Sheet, kept: Sequence[int], verdict: plausibility.Verdict, notes: tuple[str, ...]
) -> Record:
    """All columns as one series."""
    table = np.column_stack([sheet.columns[i].values for i in kept]).astype(float)
    assert verdict.rate_hz is not None
    return Record(
        samples=wrapping.unwrap(table, sheet.tail)[:, None],
        rate_hz=float(verdict.rate_hz),
        channels=("channel_0",),
        units=(sheet.unit,),
        start_ns=sheet.start_ns,
        aux=sheet.aux,
        notes=(*(n for n in sheet.notes if "cut short" not in n), *notes, *verdict.notes),
        assumptions=(*sheet.assumptions, *verdict.assumptions),
    )


def _measured(
    sheet: Sheet,
    kept: Sequence[int],
    said: _Said,
    axis: TimeAxis | None,
    gaps: Sequence[Gap],
    told: clock.Told,
) -> plausibility.Measured:
    values = [sheet.columns[i].values for i in kept]
    alone = len(kept) == len(sheet.columns) and all(v.dtype.kind in "fiu" for v in values)
    layered = alone and len(kept) > 1 and axis is None and not sheet.format
    open_to_doubt = layered and not sheet.named and said.wrapped is None
    table = np.column_stack(values).astype(float) if open_to_doubt else None
    return plausibility.Measured(
        rows=len(values[0]),
        width=len(kept),
        tail=len(sheet.tail) if layered else 0,
        missing=sum(gap.missing for gap in gaps),
        clock_rate_hz=axis.rate_hz if axis is not None else None,
        clock_sure=told.clock is None or told.clock.sure,
        given_rate_hz=said.rate_hz,
        named=sheet.named,
        smooth=table is not None and wrapping.looks_wrapped(table),
        apart=table is not None and wrapping.looks_like_channels(table),
        wrapped=said.wrapped if layered else False,
    )


def _open(
    path: Path,
    skip_lines: int | None,
    max_bytes: int,
    date_order: DateOrder | None,
    wanted: tuple[str, ...] | None,
) -> Sheet:
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
    """Arrays of one common length as columns; single numbers and other lengths apart."""
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
            found.append(Fact("rate", (number,), f"{name} = {number:g}", 0))
        elif bare in _INTERVAL_NAMES:
            found.append(Fact("interval", (number,), f"{name} = {number:g}", 0))
    return Facts(tuple(found))


def _renamed(sheet: Sheet, given: Sequence[str] | None) -> Sheet:
    """Give columns the names that a person says."""
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


def _refuse_slips(rate_hz: float | None, time_unit: str | None) -> None:
    if rate_hz is not None and not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise RecordError(
            f"{rate_hz:g} is not a sampling rate. Give samples per second, from {SLOWEST_HZ:g} "
            f"to {FASTEST_HZ:g}."
        )
    if time_unit is not None and time_unit not in UNITS:
        raise RecordError(f"{time_unit!r} is no unit of time. Allowed: {', '.join(UNITS)}.")


def _kept(
    file: str, sheet: Sheet, said: _Said, clocks: frozenset[int], *, sparse: bool
) -> tuple[tuple[int, ...], dict[str, str]]:
    """Columns to keep as channels, and why others are not."""
    names = sheet.names
    if said.channels is not None:
        return _chosen(said.channels, names, clocks, sheet), {}
    if said.wrapped:
        return tuple(range(len(names))), {}
    forced = set(range(len(names))) if tuple(said.keep) == (ALL,) else {
        find_column(name, names) for name in said.keep
    }  # fmt: skip
    apart = {
        place: reason
        for place, reason in roles.aside(
            sheet.columns,
            names,
            clocks,
            sparse=sparse,
            unnamed_clocks=(said.time_column or "").casefold() != "none",
        ).items()
        if place not in forced or sheet.columns[place].kind != "number"
    }
    kept = tuple(i for i in range(len(names)) if i not in clocks and i not in apart)
    if not kept:
        # A counter that is alone may be a sensor after all; words are none.
        kept = tuple(i for i in apart if sheet.columns[i].kind == "number")
        kept = tuple(i for i in kept if np.isfinite(sheet.columns[i].values).all())
        apart = {place: reason for place, reason in apart.items() if place not in kept}
    if not kept:
        raise RecordError(
            f"{file} has no channel beside its clock{_reasons(apart, names)}. Give a file with "
            "samples, or say which columns are some with --channels."
        )
    return kept, {names[place]: reason for place, reason in apart.items()}


def _reasons(apart: dict[int, str], names: tuple[str, ...]) -> str:
    said = "; ".join(f"{names[place]!r} is {reason}" for place, reason in apart.items())
    return f" ({said})" if said else ""


def _chosen(
    channels: Sequence[str], names: tuple[str, ...], clocks: frozenset[int], sheet: Sheet
) -> tuple[int, ...]:
    kept = tuple(find_column(name, names) for name in channels)
    for place in kept:
        if place in clocks:
            raise RecordError(
                f"{names[place]!r} is the clock of the record, not a channel. Leave it out; if "
                "it is one after all, give --time-column none and --rate-hz."
            )
        if sheet.columns[place].kind != "number":
            raise RecordError(
                f"{names[place]!r} holds {sheet.columns[place].kind}s, not numbers. Leave it "
                "out."
            )
    if len(set(kept)) != len(kept):
        raise RecordError(
            f"A channel was named twice in {', '.join(channels)}. Name each once."
        )
    return kept


def _rows_missing(
    file: str, sheet: Sheet, kept: Sequence[int], missing: _Missing
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows in which a channel has no finite value."""
    lost = np.zeros(len(sheet.columns[0].values), dtype=bool)
    for place in kept:
        column = sheet.columns[place]
        bad = ~np.isfinite(column.values) if column.values.dtype.kind == "f" else lost & False
        infinite = bad.any() and bool(np.isinf(column.values[bad]).any())
        if bad.any() and not missing.keep and (infinite or not missing.skip):
            raise _not_finite(file, sheet.names[place], column, bad)
        lost |= bad
    if missing.skip and lost.mean() > MOST_MISSING:
        raise RecordError(
            f"{file}: in {100 * lost.mean():.0f} % of its rows a value is missing; at most "
            f"{100 * MOST_MISSING:.0f} % are left out as gaps. Leave out the columns that lack "
            "them with --channels, or fill them in."
        )
    return lost


def _not_finite(
    file: str, name: str, column: Column, bad: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> RecordError:
    cure = (
        "Cut the record there, or fill the value in; the edge agent can be told to treat such "
        "values as dropouts."
    )
    if column.missing is not None:
        line, field, text = column.missing
        return RecordError(
            f"Line {line}, field {field} is {text[:40]!r}: not a finite number. {cure}"
        )
    return RecordError(
        f"{file}, column {name}: {np.count_nonzero(bad)} values are not finite, the first in "
        f"row {np.flatnonzero(bad)[0]}. {cure}"
    )


def _only_rows(sheet: Sheet, rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Sheet:
    columns = []
    for column in sheet.columns:
        stamps = column.stamps
        if stamps is not None:
            stamps = dataclasses.replace(stamps, ns=stamps.ns[rows])
        columns.append(dataclasses.replace(column, values=column.values[rows], stamps=stamps))
    return dataclasses.replace(sheet, columns=tuple(columns))


def _gaps_of_counter(
    sheet: Sheet, why: dict[str, str]
) -> tuple[tuple[Gap, ...], tuple[str, ...]]:
    """Gaps where a counter of rows leaves numbers out, and how that is said."""
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        if why.get(name) != roles.COUNTER:
            continue
        counts, _ = unwrapped(np.asarray(column.values))
        steps = np.diff(counts.astype(float))
        if len(steps) and (steps >= 1).all() and (steps == 1).mean() >= roles.SAME_STEP:
            gaps = tuple(
                Gap(int(at) + 1, int(steps[at]) - 1) for at in np.flatnonzero(steps > 1)
            )
            said = (f"Gaps are where the counter {name!r} leaves out numbers.",)
            return gaps, said * bool(gaps)
    return (), ()


def _refuse_several_sensors(file: str, sheet: Sheet) -> None:
    """Ask about rows that are of one sensor after the other."""
    clocks = [c for c in sheet.columns if c.stamps is not None or is_time_name(c.name)]
    if not any((np.diff(c.values) == 0).any() for c in clocks if c.kind != "word"):
        return
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        period = _period(column.values) if column not in clocks else 0
        if period > 1:
            found = ", ".join(map(str, column.values[:period]))
            raise RecordError(
                f"The rows of {file} are of several sensors in turn (column {name!r} repeats "
                f"{found[:80]}), with one time for all. Give one row for each instant with a "
                "column for each sensor, or --rate-hz if rows are evenly apart."
            )


def _period(values: Values) -> int:
    """Rows after which a column of few words or whole numbers repeats; 0 where it does not."""
    few = list(values[: 2 * LONGEST_PERIOD])
    for period in range(2, min(LONGEST_PERIOD, len(values) // 3) + 1):
        if few[period : 2 * period] == few[:period] and len(set(few[:period])) == period:
            return period if bool(np.all(values[period:] == values[:-period])) else 0
    return 0


def _gaps_of(rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Iterator[Gap]:
    jumps = np.diff(rows) - 1
    for at in np.flatnonzero(jumps):
        yield Gap(int(at) + 1, int(jumps[at]))


def _axis(
    told: clock.Told, said: _Said, facts: Facts
) -> tuple[TimeAxis | None, tuple[str, ...]]:
    """Give what the clock says; a rate that was given overrules it."""
    notes = told.notes
    if told.axis is None or told.clock is None:
        if told.refusal is None:
            return None, notes
        if said.rate_hz is None and (said.time_column is not None or told.columns):
            return None, (*notes, _heading_instead(facts, told.refusal))
        if said.rate_hz is not None:
            notes += (f"The clock was not used, since a rate was given: {told.refusal}",)
        return None, notes
    axis, name = told.axis, told.clock.name
    if said.rate_hz is not None and abs(axis.rate_hz / said.rate_hz - 1) > 1e-3:
        notes += (
            f"Column {name!r} says {axis.rate_hz:g} Hz; {said.rate_hz:g} Hz was given, and "
            "used.",
        )
        return dataclasses.replace(axis, rate_hz=said.rate_hz, gaps=()), notes
    notes += axis.notes
    if axis.jitter > 0.05:
        notes += (f"The clock jitters by {100 * axis.jitter:.0f} % of a step (rms).",)
    return axis, notes


def _heading_instead(facts: Facts, refusal: RecordError) -> str:
    """Note that the heading's rate is used, where uneven times have it on average.

    Raises
    ------
    RecordError
        The refusal, where the heading states no rate, or another.
    """
    stated = [value for fact in facts.of("rate") for value in fact.values]
    stated += [1 / value for fact in facts.of("interval") for value in fact.values]
    if isinstance(refusal, UnevenError) and stated and plausibility.is_near(
        refusal.mean_hz, stated[0]
    ):  # fmt: skip
        return f"The clock was not used, the heading states its mean rate: {refusal}"
    raise refusal


def _no_clock(sheet: Sheet) -> str:
    """Say why no column passes for a clock."""
    names = sheet.names
    for name, column in zip(names, sheet.columns, strict=True):
        if is_time_name(name) and column.kind == "number":
            with np.errstate(invalid="ignore"):  # two infinities in a row
                back = int(np.sum(~(np.diff(column.values.astype(float)) > 0)))
            return (
                f"column {name!r} does not run forwards in {back} of {len(column.values) - 1} "
                "steps, and is no clock as it stands. Sort the rows by time if they are out of "
                "order"
            )
    return f"no time column was found among {', '.join(names)}"


def _said_of(told: clock.Told, axis: TimeAxis | None, why: dict[str, str]) -> Iterator[str]:
    """Say what was taken for granted of the columns."""
    if told.clock is not None and axis is not None:
        yield f"{BY_CLOCK} {told.clock.said}"
    if why:
        apart = "; ".join(f"{name!r}: {reason}" for name, reason in why.items())
        yield f"set aside ({apart}), --keep keeps them"


def _say_missing(
    values: Sequence[Values],
    lost: np.ndarray[tuple[int], np.dtype[np.bool_]],
    missing: _Missing,
) -> str:
    if missing.skip:
        rows = int(np.count_nonzero(lost))
        return f"{rows} rows in which a value is missing were left out."
    count = sum(int(np.count_nonzero(~np.isfinite(v.astype(float)))) for v in values)
    return f"{count} values are missing."


def _say_gaps(gaps: tuple[Gap, ...]) -> str:
    missing = sum(gap.missing for gap in gaps)
    samples = "1 sample is" if missing == 1 else f"{missing} samples are"
    where = "1 gap," if len(gaps) == 1 else f"{len(gaps)} gaps, the first"
    return f"{samples} missing in {where} before row {gaps[0].row}."
