"""Missing rows and values: found, and refused or left out as gaps."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from slowtime_services.files.reading_options import MissingPolicy
from slowtime_services.files.record import Gap, RecordError, Values
from slowtime_services.files.sheet import Column, Sheet
from slowtime_services.files.times.time_axis import is_time_name, unwrapped

from . import auxiliary_columns

MAX_MISSING_SHARE = 0.2
"""Share of rows that may lack a value and be left out; beyond it, the file is to be mended."""


def rows_missing(
    file: str, sheet: Sheet, kept: Sequence[int], missing: MissingPolicy
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows in which a channel has no finite value.

    Rows in which none has one, at the beginning or the end, do not count among those of which
    too many may be missing: beside a longer table, a shorter one ends in empty rows.
    """
    lost = np.zeros(len(sheet.columns[0].values), dtype=bool)
    empty = ~lost
    for place in kept:
        column = sheet.columns[place]
        bad = ~np.isfinite(column.values) if column.values.dtype.kind == "f" else lost & False
        infinite = bad.any() and bool(np.isinf(column.values[bad]).any())
        if bad.any() and not missing.keep and (infinite or not missing.skip):
            raise _not_finite(file, sheet.names[place], column, bad)
        lost |= bad
        empty &= bad
    rows = np.flatnonzero(~empty)
    within = lost[rows[0] : rows[-1] + 1] if len(rows) else lost
    if missing.skip and within.mean() > MAX_MISSING_SHARE:
        raise RecordError(
            f"{file}: in {100 * within.mean():.0f} % of its rows a value is missing; at most "
            f"{100 * MAX_MISSING_SHARE:.0f} % are left out as gaps. Leave out the columns that "
            "lack them with --channels, or fill them in."
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


def rows_with_times(sheet: Sheet) -> np.ndarray[tuple[int], np.dtype[np.intp]] | None:
    """Rows in which the columns of times have a value; None where none or too many lack one."""
    lost = np.zeros(len(sheet.columns[0].values), dtype=bool)
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        if column.kind == "number" and is_time_name(name) and column.values.dtype.kind == "f":
            bad = ~np.isfinite(column.values)
            if bad.mean() <= MAX_MISSING_SHARE:
                lost |= bad
    return np.flatnonzero(~lost) if 0 < lost.mean() <= MAX_MISSING_SHARE else None


def only_rows(sheet: Sheet, rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Sheet:
    """Keep some rows of all columns."""
    columns = []
    for column in sheet.columns:
        stamps = column.stamps
        if stamps is not None:
            stamps = dataclasses.replace(stamps, ns=stamps.ns[rows])
        columns.append(dataclasses.replace(column, values=column.values[rows], stamps=stamps))
    return dataclasses.replace(sheet, columns=tuple(columns))


def gaps_of_counter(
    sheet: Sheet, why: dict[str, str]
) -> tuple[tuple[Gap, ...], tuple[str, ...]]:
    """Return gaps where a row counter skips numbers, and a note on them."""
    for name, column in zip(sheet.names, sheet.columns, strict=True):
        if why.get(name) != auxiliary_columns.COUNTER:
            continue
        counts, _ = unwrapped(np.asarray(column.values))
        steps = np.diff(counts.astype(float))
        if (
            len(steps)
            and (steps >= 1).all()
            and (steps == 1).mean() >= auxiliary_columns.COUNTER_STEP_SHARE
        ):
            gaps = tuple(
                Gap(int(at) + 1, int(steps[at]) - 1) for at in np.flatnonzero(steps > 1)
            )
            said = (f"Gaps are where the counter {name!r} leaves out numbers.",)
            return gaps, said * bool(gaps)
    return (), ()


def gaps_of(rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Iterator[Gap]:
    """Find where rows were left out, by the numbers of those that are left."""
    jumps = np.diff(rows) - 1
    for at in np.flatnonzero(jumps):
        yield Gap(int(at) + 1, int(jumps[at]))


def describe_missing(
    values: Sequence[Values],
    lost: np.ndarray[tuple[int], np.dtype[np.bool_]],
    missing: MissingPolicy,
) -> str:
    """Describe how many values are missing, or rows were left out."""
    if missing.skip:
        rows = int(np.count_nonzero(lost))
        return f"{rows} rows in which a value is missing were left out."
    count = sum(int(np.count_nonzero(~np.isfinite(v.astype(float)))) for v in values)
    return f"{count} values are missing."


def describe_gaps(gaps: tuple[Gap, ...]) -> str:
    """Describe how many samples are missing, and where the first gap is."""
    missing = sum(gap.missing for gap in gaps)
    samples = "1 sample is" if missing == 1 else f"{missing} samples are"
    where = "1 gap," if len(gaps) == 1 else f"{len(gaps)} gaps, the first"
    return f"{samples} missing in {where} before row {gaps[0].row}."
