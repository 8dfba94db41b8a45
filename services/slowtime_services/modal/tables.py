"""Modes as a table for spreadsheets: a row a mode, components of shapes in columns."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slowtime_schemas.files.modes import FoundMode, ModesFile

HEADINGS = (
    "frequency_hz", "frequency_sd_hz", "damping_ratio", "damping_ratio_sd", "correlation",
    "kind", "quality", "snr_db", "method", "flags",
)  # fmt: skip


def write_table(path: Path, found: ModesFile) -> None:
    """Write the modes of a record, or of its windows, as CSV with a heading of one line."""
    windows = found.epochs or ()
    heads = [*(("start_s", "end_s") if windows else ()), *HEADINGS]
    heads += [f"{part}_{name}" for name in found.channels for part in ("re", "im", "sd")]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(heads)
        for mode in found.modes or ():
            table.writerow(_row(mode, len(found.channels)))
        for window in windows:
            for mode in window.modes:
                span = [window.start_s, window.end_s]
                table.writerow([*span, *_row(mode, len(found.channels))])


def _row(mode: FoundMode, channels: int) -> Iterator[Any]:
    f, z = mode.frequency_hz, mode.damping_ratio
    yield from (f.value, f.sd, z.value, z.sd, mode.correlation, mode.kind, mode.quality)
    yield from (mode.snr_db, mode.method, " ".join(mode.flags))
    if mode.shape is None:
        yield from [None] * 3 * channels
        return
    for parts in zip(mode.shape.re, mode.shape.im, mode.shape.sd, strict=True):
        yield from parts
