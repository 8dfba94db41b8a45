"""Reading of a whole record from a file of any kind.

The stages: a file becomes a `Sheet` of columns with names, units and the figures of its
heading (`file_sheet`); its clock is found (`clocks.record_clock`), then columns that are no
channels (`channels.selection`); the rest is compared with the heading (`plausibility`), which
also decides whether columns are channels or one series. Assumptions made on the way are noted
in the record.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slowtime.signals.value_checks import value_notes
from slowtime_services.declared import takes

from . import plausibility
from .channels import sentinels, wrapped_rows
from .channels.missing_values import (
    describe_gaps,
    describe_missing,
    gaps_of,
    gaps_of_counter,
    only_rows,
    rows_missing,
    rows_with_times,
)
from .channels.repeated_rows import new_rows, without_copies
from .channels.selection import select_channels, unit_of_channel
from .channels.separate_series import refuse_separate_runs, refuse_several_sensors
from .channels.si_conversion import in_si
from .clocks import candidates
from .clocks.record_clock import axis_of, clock_of_sheet, clock_words, no_clock, start_of
from .file_sheet import open_sheet, pairs_unwrapped, renamed
from .reading_options import MissingPolicy, ReadingOptions, RecordReading
from .record import Gap, Record, RecordError, Values, in_sensor_type
from .sheet import Column, Sheet
from .times.even_samples import between_rows, chosen_axis, sampled_evenly
from .times.time_axis import TimeAxis

MIN_RATE_HZ, MAX_RATE_HZ = 1e-6, 1e9
"""Sampling rates that a person may give [Hz]; beyond them a rate is a typing error."""


# Values of a damaged file may be so large that their squares are infinite: a pattern that
# is looked for is then not there, and what stands in the file is kept.
@takes(RecordReading)
@np.errstate(over="ignore", invalid="ignore")
def read_record(path: str | Path, options: RecordReading) -> Record:
    """Read a record of measurements from a file.

    Text of any delimiter (comma, tab, semicolon, bar, blanks; decimal point or comma), with
    or without preamble, header, units and time column; NumPy ``.npy`` and ``.npz``; MATLAB
    ``.mat`` of version 5 and of version 7.3. Arrays may lie either way: the longer side is
    time.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Samples in SI where their unit is one of motion, else as the file has them; see
    `slowtime_services.files.channels.si_conversion`.

    Raises
    ------
    RecordError
        (a ValueError) where the file is no record, or may be read in several ways; the text
        says what to do. OSError where it cannot be opened.
    """
    path = Path(path)
    _refuse_implausible_rate(options.rate_hz)
    size = path.stat().st_size
    if size > options.max_bytes:
        raise RecordError(
            f"{path.name} has {size / 2**20:.0f} MiB; at most "
            f"{options.max_bytes / 2**20:.0f} MiB are read at once. Cut it into several files, "
            "or raise max_bytes."
        )
    missing = MissingPolicy(options.keep_missing, options.skip_missing)
    chosen = None if options.channels is None else tuple(options.channels)
    sheet = open_sheet(path, options.skip_lines, options.max_bytes, options.date_order, chosen)
    sheet = renamed(sheet, options.columns)
    if options.of_a_piece:
        sheet = dataclasses.replace(sheet, facts=sheet.facts.of_any_length)
    if len(sheet.columns[0].values) < 2 and len(sheet.columns) + len(sheet.tail) < 2 + (
        sheet.facts.found == ()
    ) * len(sheet.columns):
        raise RecordError(f"{path.name} has a single row. Give a record of at least two.")
    record = _record(path.name, pairs_unwrapped(sheet), options, missing, options.of_a_piece)
    if options.rate_hz is None:
        plausibility.refuse_beyond(path.name, record.rate_hz)
    return in_si(record, options.units, options.sensitivities)


def _refuse_implausible_rate(rate_hz: float | None) -> None:
    if rate_hz is not None and not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise RecordError(
            f"{rate_hz:g} is not a sampling rate. Give samples per second, from "
            f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}."
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _SampleRows:
    """Rows of a sheet that are samples, their clock, and what was said on the way."""

    sheet: Sheet
    told: candidates.ChosenClock
    of_all_rows: candidates.ChosenClock
    kept: Sequence[int]
    why: dict[str, str]
    rows: np.ndarray[tuple[int], np.dtype[np.intp]]
    lost: np.ndarray[tuple[int], np.dtype[np.bool_]]
    notes: tuple[str, ...]


def _record(
    file: str,
    sheet: Sheet,
    said: ReadingOptions,
    missing: MissingPolicy,
    of_a_piece: bool = False,
) -> Record:
    """Decide the columns, check them against the heading, and collect the samples."""
    found = _rows_of_samples(file, sheet, said, missing)
    sheet, told, kept = found.sheet, found.told, found.kept
    axis, notes = axis_of(told, said, sheet.facts)
    notes = (*found.notes, *notes)
    if of_a_piece:
        _refuse_wandering(axis)
    elif axis is not None and axis.stamped is not None:
        stated = axis
        axis = chosen_axis(np.column_stack([sheet.columns[i].values for i in kept]), stated)
        notes += axis.notes[len(stated.notes) :]
    gaps, counted = _gaps(found, axis, missing)
    measured = _measured(sheet, kept, said, axis, gaps, told)
    verdict = plausibility.judge(file, sheet.facts, measured)
    if verdict.rate_hz is None:
        raise told.refusal or _without_rate(file, sheet)
    notes += counted
    clocked = said.rate_hz is not None or told.clock is not None
    if not clocked and told.refusal is not None and told.columns:
        notes += (f"The column of times was not used: {told.refusal}",)
    if verdict.wrapped:
        return _series(sheet, kept, verdict, notes)
    if found.lost.any():
        values = [sheet.columns[i].values for i in kept]
        notes += (describe_missing(values, found.lost, missing),)
    if gaps:
        notes += (describe_gaps(gaps),)
    start_ns, said_start = _start(found, axis, missing, verdict.rate_hz)
    record = Record(
        samples=in_sensor_type(
            _finite(np.column_stack([sheet.columns[i].values for i in kept]))
        ),
        rate_hz=float(verdict.rate_hz),
        channels=tuple(sheet.names[i] for i in kept),
        units=tuple(unit_of_channel(sheet, i, kept) for i in kept),
        start_ns=start_ns,
        gaps=gaps,
        aux=_others(sheet, kept),
        notes=(*sheet.notes, *notes, *verdict.notes),
        assumptions=(
            *sheet.assumptions,
            *clock_words(told, axis, found.why),
            *verdict.assumptions,
            *said_start,
        ),
    )
    return _with_new_rows(file, record, axis, said, of_a_piece=of_a_piece)


def _rows_of_samples(
    file: str, sheet: Sheet, said: ReadingOptions, missing: MissingPolicy
) -> _SampleRows:
    """Choose channels, and rows that have times and values and are no copies."""
    told = clock_of_sheet(sheet, said)
    timed = np.arange(len(sheet.columns[0].values))
    if told.clock is None and (missing.skip or missing.keep):
        sheet, timed, told = _rows_with_times(sheet, said, told)
    of_all_rows = told
    kept, why = select_channels(file, sheet, said, told.columns, sparse=not missing.keep)
    refuse_separate_runs(file, sheet, kept, said)
    if said.rate_hz is None:
        refuse_several_sensors(file, sheet, told.columns)
    if said.repeated != "keep":
        sheet, new = without_copies(sheet, kept, told.columns)
        if not new.all():
            timed, told = timed[new], clock_of_sheet(sheet, said)
    sheet, notes = sentinels.as_missing(file, sheet, kept, missing)
    lost = rows_missing(file, sheet, kept, missing)
    rows = timed[~lost]
    if missing.skip and lost.any():
        sheet = only_rows(sheet, np.flatnonzero(~lost))
        told = clock_of_sheet(sheet, said)
    return _SampleRows(sheet, told, of_all_rows, kept, why, rows, lost, tuple(notes))


def _gaps(
    found: _SampleRows, axis: TimeAxis | None, missing: MissingPolicy
) -> tuple[tuple[Gap, ...], tuple[str, ...]]:
    """Gaps by the clock, the rows that were left out, or a counter; and what to say of them."""
    if axis is not None:
        return axis.gaps, ()
    if missing.skip and (gaps := tuple(gaps_of(found.rows))):
        return gaps, ()
    return gaps_of_counter(found.sheet, found.why)


def _start(
    found: _SampleRows, axis: TimeAxis | None, missing: MissingPolicy, rate_hz: float
) -> tuple[int | None, tuple[str, ...]]:
    """Time of the first sample [ns], and what was assumed of it."""
    start_ns, said = start_of(found.sheet, axis, found.of_all_rows)
    by_clock = axis is not None and axis.start_ns is not None
    if start_ns is not None and not by_clock and missing.skip and found.lost.any():
        # The heading tells when the first row was taken, which may have been left out.
        start_ns += round(int(found.rows[0]) * 1e9 / rate_hz)
    return start_ns, said


def _others(sheet: Sheet, kept: Sequence[int]) -> dict[str, Values]:
    """Return columns of numbers that are no channels, beside what the file has else."""
    others = {
        name: _column_values(sheet.columns[i])
        for i, name in enumerate(sheet.names)
        if i not in kept
    }
    return {**sheet.aux, **{k: v for k, v in others.items() if v.dtype.kind in "fiub"}}


def _with_new_rows(
    file: str, record: Record, axis: TimeAxis | None, said: ReadingOptions, *, of_a_piece: bool
) -> Record:
    """Leave out held rows or interpolate uneven ones, and check the values."""
    samples, aux = record.samples, dict(record.aux)
    new_of = new_rows(
        file, samples, record.channels, record.rate_hz, axis, said, of_a_piece=of_a_piece
    )
    if new_of.rows is not None:
        samples, aux = samples[new_of.rows], _rows_of(aux, new_of.rows, len(samples))
    elif axis is not None and axis.seconds is not None:
        samples, aux = _at_even_times(samples, aux, axis)
    values = value_notes(np.asarray(samples, dtype=float), record.channels, new_of.rate_hz)
    return dataclasses.replace(
        record,
        samples=samples,
        rate_hz=float(new_of.rate_hz),
        gaps=record.gaps if new_of.rows is None else (),
        aux=aux,
        notes=(*record.notes, *new_of.notes, *values),
    )


def _rows_with_times(
    sheet: Sheet, said: ReadingOptions, told: candidates.ChosenClock
) -> tuple[Sheet, np.ndarray[tuple[int], np.dtype[np.intp]], candidates.ChosenClock]:
    """Rows that have a time, and the clock of them, where it lacks some times.

    A row without a time cannot be placed: it is left out, which the clock shows as a gap.
    """
    rows = rows_with_times(sheet)
    if rows is not None:
        timed = only_rows(sheet, rows)
        again = clock_of_sheet(timed, said)
        if again.clock is not None:
            lost = len(sheet.columns[0].values) - len(rows)
            which = (
                "1 row without a time was" if lost == 1 else f"{lost} rows without a time were"
            )
            note = f"{which} left out, by column {again.clock.name!r}."
            timed = dataclasses.replace(timed, notes=(*timed.notes, note))
            return timed, rows, again
    return sheet, np.arange(len(sheet.columns[0].values)), told


def _without_rate(file: str, sheet: Sheet) -> RecordError:
    doubtful = ", ".join(f"{f.text!r} (line {f.line})" for f in sheet.facts.doubtful[:3])
    may = f" What its heading states, {doubtful}, may be of something else." if doubtful else ""
    return RecordError(
        f"{file} does not say how often it was sampled: {no_clock(sheet)}.{may} "
        "Give --rate-hz, or name the clock with --reading time_column."
    )


def _refuse_wandering(axis: TimeAxis | None) -> None:
    """Refuse a piece of a longer file whose samples would have to be interpolated."""
    if axis is not None and axis.seconds is not None:
        raise RecordError(
            f"{axis.notes[-1]} A file that is read as a stream cannot be: read it at once with "
            "--whole, or give --rate-hz."
        )


def _at_even_times(
    samples: Values, aux: dict[str, Values], axis: TimeAxis
) -> tuple[Values, dict[str, Values]]:
    """Interpolate the channels, and what else has a value in each row, at even times."""
    rows_of = {k: v for k, v in aux.items() if np.shape(v) == (len(samples),)}
    others = {name: between_rows(column, axis) for name, column in rows_of.items()}
    return sampled_evenly(samples, axis), {**aux, **others}


def _rows_of(
    aux: dict[str, Values], rows: np.ndarray[tuple[int], np.dtype[np.intp]], count: int
) -> dict[str, Values]:
    """Keep some rows of what has a value in each."""
    return {k: v[rows] if np.shape(v) == (count,) else v for k, v in aux.items()}


def _series(
    sheet: Sheet,
    kept: Sequence[int],
    verdict: plausibility.ReadingVerdict,
    notes: tuple[str, ...],
) -> Record:
    """Return all columns as one series."""
    table = np.column_stack([sheet.columns[i].values for i in kept]).astype(float)
    assert verdict.rate_hz is not None
    return Record(
        samples=wrapped_rows.unwrap(table, sheet.tail)[:, None],
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
    said: ReadingOptions,
    axis: TimeAxis | None,
    gaps: Sequence[Gap],
    told: candidates.ChosenClock,
) -> plausibility.RowFigures:
    values = [sheet.columns[i].values for i in kept]
    alone = len(kept) == len(sheet.columns) and all(v.dtype.kind in "fiu" for v in values)
    layered = alone and len(kept) > 1 and axis is None and not sheet.format
    open_to_doubt = layered and not sheet.named and said.wrapped is None
    table = np.column_stack(values).astype(float) if open_to_doubt else None
    return plausibility.RowFigures(
        rows=len(values[0]),
        width=len(kept),
        tail=len(sheet.tail) if layered else 0,
        missing=sum(gap.missing for gap in gaps),
        clock_rate_hz=axis.rate_hz if axis is not None else None,
        clock_sure=told.clock is None or told.clock.sure,
        given_rate_hz=said.rate_hz,
        named=sheet.named,
        smooth=table is not None and wrapped_rows.looks_wrapped(table),
        apart=table is not None and wrapped_rows.looks_like_channels(table),
        wrapped=said.wrapped if layered else False,
    )


def _column_values(column: Column) -> Values:
    """Values of a column that is no channel; of stamps, seconds from the first."""
    if column.stamps is None:
        return column.values
    return np.asarray((column.values - column.values[0]) * 1e-9)


def _finite(samples: Values) -> Values:
    """Replace infinite values by NaN."""
    if samples.dtype.kind != "f" or not np.isinf(samples).any():
        return samples
    return np.where(np.isfinite(samples), samples, np.nan)
