"""Cuts a part out of a record, with its gaps and its clock."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from .record import Gap, Record, RecordError


def part_of(record: Record, first_s: float, last_s: float, *, name: str) -> Record:
    """Cut the seconds from `first_s` to `last_s` out of a record, its clock with them.

    Parameters
    ----------
    record
        The whole record.
    first_s, last_s
        Times from its beginning [s].
    name
        Name for messages.

    Returns
    -------
    The part, with its gaps and its start.

    Raises
    ------
    RecordError
        If the part has fewer than two samples.
    """
    late = np.zeros(len(record.samples), dtype=int)
    for gap in record.gaps:
        late[gap.row :] += gap.missing
    seconds = (np.arange(len(late)) + late) / record.rate_hz
    first, last = (int(n) for n in np.searchsorted(seconds, (first_s, last_s)))
    if last - first < 2:
        raise RecordError(
            f"{name} has {seconds[-1]:.6g} s; {first_s:g}:{last_s:g} is no part of it. Give "
            "seconds from its beginning, FROM:TO."
        )
    start_ns = record.start_ns
    begins = None if start_ns is None else start_ns + round(float(seconds[first]) * 1e9)
    return dataclasses.replace(
        record,
        samples=record.samples[first:last],
        start_ns=begins,
        gaps=tuple(_within(record, first, last)),
        aux={
            key: value[first:last] if np.shape(value)[:1] == (len(late),) else value
            for key, value in record.aux.items()
        }
        | ({} if _clocked(record) else {"t": seconds[first:last]}),
    )


def _within(record: Record, first: int, last: int) -> Iterator[Gap]:
    for gap in record.gaps:
        if first < gap.row < last:
            yield Gap(gap.row - first, gap.missing)


def _clocked(record: Record) -> bool:
    """Whether the record states the time of each sample."""
    count = (len(record.samples),)
    return record.start_ns is not None or any(
        np.shape(value) == count for value in record.aux.values()
    )
