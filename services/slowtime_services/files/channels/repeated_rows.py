"""Rows that repeat the one before: dropped where that is certain, else a question."""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Bool, Int

from slowtime.signals.repeated_samples import Hold, equal_to_last, find_hold
from slowtime_services.files.reading_options import ReadingOptions
from slowtime_services.files.record import RecordError, Values
from slowtime_services.files.sheet import Sheet
from slowtime_services.files.times.time_axis import TimeAxis

from .missing_values import only_rows

COPIES = 0.99
"""Share of the rows with the time of the row before [1] that repeat its values too, from which
they are copies: readings of a coarse clock share times, and differ."""


def without_copies(
    sheet: Sheet, kept: Sequence[int], clocks: Collection[int]
) -> tuple[Sheet, Bool[np.ndarray, " time"]]:
    """Drop rows whose time and values are those of the row before, with a note.

    Parameters
    ----------
    kept
        Places of the channels.
    clocks
        Places of the columns of times.

    Returns
    -------
    The sheet, and which of its rows were kept.
    """
    rows = len(sheet.columns[0].values)
    everything = np.ones(rows, dtype=bool)
    if not clocks or not kept or rows < 3:
        return sheet, everything
    same_time = _same(sheet, clocks)
    copies = same_time & _same(sheet, kept)
    if not copies.any() or copies.sum() < COPIES * same_time.sum():
        return sheet, everything
    note = (
        f"{copies.sum()} of {rows} rows repeat time and values of the row before, as when a "
        "reader polls faster than the sensor measures; they were left out."
    )
    sheet = only_rows(sheet, np.flatnonzero(~copies))
    return dataclasses.replace(sheet, notes=(*sheet.notes, note)), ~copies


def _same(sheet: Sheet, places: Collection[int]) -> Bool[np.ndarray, " time"]:
    found = [equal_to_last(sheet.columns[place].values[:, None]) for place in places]
    return np.asarray(np.all(found, axis=0))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class NewRows:
    """Rows of a record that are left, None for all, and their rate [Hz]."""

    rows: Int[np.ndarray, " new"] | None
    rate_hz: float
    notes: tuple[str, ...] = ()


def new_rows(
    file: str,
    samples: Values,
    names: Sequence[str],
    rate_hz: float,
    axis: TimeAxis | None,
    said: ReadingOptions,
    *,
    of_a_piece: bool,
) -> NewRows:
    """Find rows that do not repeat the one before, where a sensor's value was held.

    Parameters
    ----------
    rate_hz
        Rate of the rows [Hz].
    of_a_piece
        Whether it is a piece of a longer file, of which rows cannot be dropped.

    Raises
    ------
    RecordError
        Where new rows do not come evenly, or a rate was given that may be that of all rows or
        of the new ones; the text names the options.
    """
    if said.repeated == "keep":
        return NewRows(None, rate_hz)
    columns = np.asarray(samples, dtype=float)
    hold = find_hold(columns, None if axis is None else axis.seconds)
    if hold is None:
        return NewRows(None, rate_hz, _held_channels(columns, rate_hz, names))
    share = (
        f"{100 * hold.share:.0f} % of the rows of {file} repeat the row before in all channels"
    )
    if of_a_piece:
        raise RecordError(
            f"{share}, as when a reader polls faster than the sensor measures. Read the file "
            "at once with --whole, or give --reading repeated=keep."
        )
    even = hold.even and said.rate_hz is None and not (axis is not None and axis.gaps)
    if not even and said.repeated is None:
        raise RecordError(f"{share}, {_question(hold, rate_hz, said.rate_hz is not None)}")
    new_hz = rate_hz if said.rate_hz is not None else _rate_of(hold, rate_hz, axis)
    note = (
        f"{share}, as when a reader polls faster than the sensor measures. They were left out: "
        f"{len(hold.first)} rows at {new_hz:.6g} Hz are used. --reading repeated=keep keeps "
        "them."
    )
    return NewRows(hold.first, new_hz, (note,))


def _rate_of(hold: Hold, rate_hz: float, axis: TimeAxis | None) -> float:
    if axis is None or axis.seconds is None:
        return rate_hz / hold.ratio
    times = axis.seconds[hold.first]
    return float((len(times) - 1) / (times[-1] - times[0]))


def _question(hold: Hold, rate_hz: float, given: bool) -> str:
    if given:
        return (
            "as when a reader polls faster than the sensor measures. Say of which rows "
            f"{rate_hz:g} Hz is the rate: of all with --reading repeated=keep, of new ones "
            "with --reading repeated=drop."
        )
    return (
        "and new rows do not come evenly: a reader polls faster than the sensor measures, or "
        "lost samples were filled with the last one. Images of the modes would be taken for "
        f"modes. Give --reading repeated=drop for {rate_hz / hold.ratio:.6g} Hz, the mean "
        "rate of new rows; give --reading repeated=keep if each row was measured."
    )


def _held_channels(columns: Values, rate_hz: float, names: Sequence[str]) -> tuple[str, ...]:
    """Note channels that repeat their own values evenly while others do not."""
    if columns.shape[1] < 2:
        return ()
    notes = []
    for place, name in enumerate(names):
        hold = find_hold(columns[:, [place]])
        if hold is not None and hold.even and hold.ratio > 1:
            notes.append(
                f"Channel {name!r} repeats each value over {hold.ratio:.3g} rows, as that of a "
                f"slower sensor that is held. Above {rate_hz / hold.ratio / 2:.4g} Hz it holds "
                "images only; leave it out with --channels."
            )
    return tuple(notes)
