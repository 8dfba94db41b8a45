"""Set-ups of sensors merged before identification (PreGER): one model of all records."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.identification.automatic.set_ups import JointModes, merge_records
from slowtime.identification.subspace.setup_merging import SetUpRecord
from slowtime.signals.decimation import PASS, decimated
from slowtime_cli.shared.record_input import note_reading, read_any
from slowtime_cli.shared.terminal import counting, note
from slowtime_services.files import ReadingOptions, Record, bridged

FEWEST_LAGS, MOST_LAGS = 20, 60
"""Lags in a block row [samples]: a period of the lowest frequency of the band, within bounds
that keep a run to a minute."""

HIGHEST_ORDER = 30
"""Highest model order: two for each mode, and as many again for noise [1]."""

RATES_ALIKE = 1e-4
"""Relative difference of two sampling rates [1] that is rounding, or that of a crystal from
day to day. Source: stated tolerance of crystals, 100 ppm, by which frequencies are wrong."""


def merged_records(
    files: Sequence[Path],
    references: tuple[str, ...] | None,
    rate_hz: float | None,
    band_hz: tuple[float, float],
) -> tuple[JointModes, dict[str, Any]]:
    """Identify the modes of a structure from the records of all set-ups at once.

    Parameters
    ----------
    files
        Records of the same rate.
    references
        Channels that stayed in place; None for those that all records have.
    rate_hz
        Sampling rate of records that do not state theirs [Hz].
    band_hz
        Band of the modes [Hz].

    Returns
    -------
    Modes, and the heading of a modes file.

    Raises
    ------
    click.UsageError
        Where rates differ, or the band does not fit them.
    ValueError
        Where set-ups share no reference channel.
    """
    read = [_read(path, rate_hz) for path in files]
    rate = _common_rate(read, band_hz)
    common = [name for name in read[0].channels if all(name in one.channels for one in read)]
    kept = tuple(common) if references is None else references
    factor = max(1, math.floor(0.5 * PASS * rate / band_hz[1]))
    setups = [_setup(one, factor) for one in read]
    lower = rate / factor
    lags = min(max(round(lower / band_hz[0]), FEWEST_LAGS), MOST_LAGS)
    with counting("Identifying"):
        found = merge_records(
            setups,
            lower,
            kept,
            block_rows=lags,
            orders=range(2, HIGHEST_ORDER + 1),
            band_hz=band_hz,
        )
    for text in found.notes:
        note(f"not found in all records together: {text}")
    span = max(one.duration_s for one in read)
    heading = {
        "slowtime_modes": 1,
        "record": " + ".join(path.name for path in files)[:200],
        "rate_hz": rate,
        "channels": list(found.channels),
        "duration_s": span,
        "assumptions": list(found.notes),
    }
    return found, heading


def _common_rate(read: Sequence[Record], band_hz: tuple[float, float]) -> float:
    """Return the sampling rate of all records [Hz]; refuse other rates and bands above it."""
    rate = read[0].rate_hz
    other = next((one for one in read if abs(one.rate_hz / rate - 1) > RATES_ALIKE), None)
    if other is not None or not 0 < band_hz[0] < band_hz[1] < 0.5 * rate:
        rates = ", ".join(f"{one.rate_hz:g}" for one in read)
        raise click.UsageError(
            f"Records of {rates} Hz and a band of {band_hz[0]:g} to {band_hz[1]:g} Hz were "
            "given. Merging before identification needs one rate and a band below half of it."
        )
    return rate


def _read(path: Path, rate_hz: float | None) -> Record:
    record = read_any(path, ReadingOptions(rate_hz=rate_hz))
    note_reading(record)
    record, said = bridged(record)
    if said:
        note(said)
    if record.gaps:
        raise click.UsageError(
            f"{path.name} has {len(record.gaps)} gaps that are too long to be filled. Cut the "
            "record there."
        )
    return record


def _setup(record: Record, factor: int) -> SetUpRecord:
    samples = np.asarray(record.samples, dtype=float)
    if factor > 1:
        samples = decimated(samples, record.rate_hz, factor).samples
    return SetUpRecord(samples=samples - samples.mean(axis=0), channels=tuple(record.channels))
