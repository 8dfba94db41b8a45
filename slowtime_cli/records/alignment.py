"""Alignment of the records of two boards on one structure to one clock."""

import dataclasses
import itertools

import click
import numpy as np

from slowtime.identification.clock_alignment.alignment import align
from slowtime.identification.clock_alignment.boards import BoardRecord
from slowtime_cli.shared.terminal import note
from slowtime_services.files import Record, accelerations


@dataclasses.dataclass(frozen=True, slots=True)
class ClockErrors:
    """Standard deviations of the boards' clocks: start and rate."""

    start_sd_ms: float
    rate_sd_ppm: float


def aligned_record(
    first: Record,
    second: Record,
    clocks: ClockErrors,
    band_hz: tuple[float, float] | None,
) -> Record:
    """Align both records to the clock of the one that samples faster.

    Raises
    ------
    click.ClickException
        Where that cannot be done, with the reason.
    """
    apart_s = _apart_s(first, second)
    found = align(
        _board(first, 0.0, clocks, first=True), _board(second, apart_s, clocks), band_hz=band_hz
    )
    if found.merged is None:
        raise click.ClickException(
            f"{found.sentence} Without --with, each record is identified alone."
        )
    note(found.sentence)
    merged = found.merged
    begins_ns = first.start_ns
    if begins_ns is not None:
        begins_ns += round(merged.start_s * 1e9)
    return Record(
        samples=merged.samples,
        rate_hz=merged.rate_hz,
        channels=_told_apart(merged.channels, len(_chosen(first))),
        units=(*_units(first), *_units(second)),
        start_ns=begins_ns,
        notes=(*first.notes, *second.notes, found.sentence),
        assumptions=(*first.assumptions, *second.assumptions),
    )


def _apart_s(first: Record, second: Record) -> float:
    if first.start_ns is None or second.start_ns is None:
        note("not both records say when they began; they are taken to begin together.")
        return 0.0
    return (second.start_ns - first.start_ns) / 1e9


def _board(
    record: Record, start_s: float, clocks: ClockErrors, *, first: bool = False
) -> BoardRecord:
    """Make a board of the longest part without a gap; the second has all clock error."""
    edges = [0, *(gap.row for gap in record.gaps), len(record.samples)]
    lost = np.cumsum([0, *(gap.missing for gap in record.gaps)])
    parts = [
        (b - a, a, int(m)) for (a, b), m in zip(itertools.pairwise(edges), lost, strict=True)
    ]
    rows, at, missing = max(parts)
    columns = _chosen(record)
    return BoardRecord(
        samples=np.asarray(record.samples, dtype=float)[at : at + rows, columns],
        channels=tuple(record.channels[column] for column in columns),
        rate_hz=record.rate_hz,
        rate_sd=0.0 if first else clocks.rate_sd_ppm * 1e-6 * 2**0.5,
        start_s=start_s + (at + missing) / record.rate_hz,
        start_sd_s=0.0 if first else clocks.start_sd_ms / 1e3 * 2**0.5,
    )


def _chosen(record: Record) -> list[int]:
    names = accelerations(record.channels, record.units)
    return [record.channels.index(name) for name in names]


def _units(record: Record) -> tuple[str, ...]:
    return tuple(record.units[column] for column in _chosen(record))


def _told_apart(channels: tuple[str, ...], of_first: int) -> tuple[str, ...]:
    """Names of the second record with a mark where the first has the same."""
    ours = channels[:of_first]
    return (*ours, *(f"{name} (2)" if name in ours else name for name in channels[of_first:]))
