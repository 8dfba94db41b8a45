"""Codes that loggers write in the place of a value which is missing, such as 9999."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime_services.files.reading_options import MissingPolicy
from slowtime_services.files.record import RecordError
from slowtime_services.files.sheet import Sheet

CODES = (
    999.0, 9999.0, 99999.0, 999999.0, 9999999.0, 999.25, 999.99, 9999.99, 99999.99, 6999.0,
    7999.0, 32768.0, 2147483648.0, 8388608.0, 1e20, 1e30, 1e31, 1e35, 1.70141e38, 9.96921e36,
    3.402823e38, 1.797693e308,
)  # fmt: skip
"""Sizes of known codes, of either sign: nines, the Log ASCII Standard's -999.25, Campbell's
7999, the least integers of 16, 24 and 32 bits, netCDF's fill value, the largest floats."""
CODE_TOLERANCE = 1e-6
"""Relative difference [1] up to which a number is a code: the largest floats are printed with
seven digits."""
FAR = 3.0
"""Distance of a code from all other values, in ranges of these [1], from which it is none of
them. Ten times the usual crest of a vibration beyond its largest value is less."""
IN_DOUBT = 0.5
"""The same distance [1] from which a code that is repeated is told, and kept."""


def as_missing(
    file: str, sheet: Sheet, kept: Sequence[int], missing: MissingPolicy
) -> tuple[Sheet, tuple[str, ...]]:
    """Replace codes for missing values by NaN in the channels, with a note for each.

    Parameters
    ----------
    kept
        Places of the channels.
    missing
        Where missing values are neither kept nor skipped, codes are refused as they are.

    Raises
    ------
    RecordError
        Where there is a code, and missing values are refused.
    """
    columns, names = list(sheet.columns), sheet.names
    notes: list[str] = []
    for place in kept:
        column, name = columns[place], names[place]
        if column.kind != "number" or column.values.dtype.kind not in "fiu":
            continue
        values = column.values.astype(float)
        for code, where, sure in _codes(values):
            count = int(np.count_nonzero(where))
            rows = "1 row" if count == 1 else f"{count} rows"
            said = f"{code:.10g} stands in {rows} of {name!r}, far beyond all other values"
            if not sure:
                notes.append(f"{said}, and was kept: if it marks missing values, cut them out.")
                continue
            if not (missing.keep or missing.skip):
                raise RecordError(
                    f"{file}: {said} (the first in row {np.flatnonzero(where)[0]}), as loggers "
                    "mark missing values. Cut the record there, or fill the values in."
                )
            values = np.where(where, np.nan, values)
            columns[place] = dataclasses.replace(column, values=values, missing=None)
            notes.append(f"{said}: it was taken to mark missing values.")
    return dataclasses.replace(sheet, columns=tuple(columns)), tuple(notes)


def _codes(
    values: Float[np.ndarray, " time"],
) -> Iterator[tuple[float, Bool[np.ndarray, " time"], bool]]:
    """Codes among the extremes of a channel, where they stand, and whether they are sure."""
    rest = np.isfinite(values)
    outer: list[tuple[float, Bool[np.ndarray, " time"]]] = []
    while rest.any():
        extremes = float(values[rest].min()), float(values[rest].max())
        code = max(filter(_is_code, extremes), key=abs, default=None)
        if code is None:
            break
        where = rest & (values == code)
        outer.append((code, where))
        rest &= ~where
    if not rest.any():
        return
    low, high = float(values[rest].min()), float(values[rest].max())
    for code, where in reversed(outer):
        span, distance = high - low, max(low - code, code - high)
        if distance > FAR * span > 0:
            yield code, where, True
            continue
        if distance > IN_DOUBT * span > 0 and np.count_nonzero(where) > 1:
            yield code, where, False
        low, high = min(low, code), max(high, code)


def _is_code(value: float) -> bool:
    return bool(np.isclose(abs(value), CODES, rtol=CODE_TOLERANCE, atol=0.0).any())
