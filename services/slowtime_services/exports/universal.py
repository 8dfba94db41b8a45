"""A record as a universal file: a binary dataset 58 (58b) for each channel.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: number 58, function at nodal DOF", and "58b, binary".
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slowtime_services.files import Record, RecordError
from slowtime_services.files.formats.universal import MARK
from slowtime_services.files.units import unit_of
from slowtime_services.modal import NodeAxis, places_of

TIME_RESPONSE, EVEN, TIME = 1, 1, 17
"""Function type, spacing and abscissa of a record [1]_."""
SINGLE, DOUBLE = 2, 4
_LITTLE_ENDIAN, _IEEE, _ASCII_LINES = 1, 2, 11
_ORDINATES = {"displacement": 8, "velocity": 11, "acceleration": 12}
_WIDE = 80


def write_universal(path: Path, record: Record) -> None:
    """Write a dataset a channel, with its unit and its start to the nanosecond.

    Raises
    ------
    RecordError
        Where samples are missing: evenly spaced functions have no place for that.
    """
    if record.gaps:
        raise RecordError(
            f"{sum(gap.missing for gap in record.gaps)} samples are missing within the record, "
            "which a universal file cannot say. Write .csv or .parquet, whose clock shows it, "
            "or cut the record at its gaps."
        )
    double = record.samples.dtype not in (np.float32, np.int16)
    kind = np.dtype("<f8" if double else "<f4")
    places = _places(record.channels)
    with path.open("wb") as file:
        for column, place in enumerate(places):
            body = np.ascontiguousarray(record.samples[:, column], dtype=kind).tobytes()
            lines = _heading(record, column, place, DOUBLE if double else SINGLE)
            first = (
                f"{58:6d}b{_LITTLE_ENDIAN:6d}{_IEEE:6d}{_ASCII_LINES:12d}{len(body):12d}"
                f"{0:6d}{0:6d}{0:12d}{0:12d}"
            )
            text = "".join(f"{line}\n" for line in (f"{-1:6d}", first, *lines))
            file.write(text.encode("latin-1", "replace") + body + f"{-1:6d}\n".encode())


def _places(channels: Sequence[str]) -> Sequence[NodeAxis]:
    try:
        return places_of(channels)
    except RecordError:  # two names with one ending: a node each
        return [NodeAxis(number, 1) for number in range(1, len(channels) + 1)]


def _heading(record: Record, column: int, place: NodeAxis, kind: int) -> list[str]:
    name, unit = record.channels[column], record.units[column]
    known = unit_of(unit, name)
    start = "NONE" if record.start_ns is None else str(np.datetime64(record.start_ns, "ns"))
    plain = "".join(c if c.isprintable() else " " for c in name)[:_WIDE].strip()
    return [
        plain or "NONE", MARK, start, "NONE", "NONE",
        f"{TIME_RESPONSE:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{place.node:10d}{place.axis:4d} "
        f"{'NONE':<10}{0:10d}{0:4d}",
        f"{kind:10d}{len(record.samples):10d}{EVEN:10d}{0.0:13.5E}{1 / record.rate_hz:13.6E}"
        f"{0.0:13.5E}",
        _axis(TIME, "Time", "s"),
        _axis(_ORDINATES[known.quantity] if known else 0, "Response", unit or "NONE"),
        _axis(0, "NONE", "NONE"),
        _axis(0, "NONE", "NONE"),
    ]  # fmt: skip


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20.20} {unit:<20.20}"
