"""TDMS files of National Instruments, by npTDMS."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from slowtime_services.files.binary.numpy_arrays import refuse_above
from slowtime_services.files.record import RecordError

from .found import Found, Series

MOST_MISSING = 1.0
"""Part of a file that may be missing at its end, in proportion to what is there [1]: a
recording that was interrupted lacks a part of its last segment."""

_LEAD_IN = struct.Struct("<4sIIQQ")
_INTERRUPTED = 2**64 - 1
"""Length of a segment whose writing was interrupted, as LabVIEW writes it before it ends."""
_UNIT_KEYS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units")


def read(path: Path, max_bytes: int) -> Found:
    """Return each channel of numbers; its name with its group's where there are several."""
    series: list[Series] = []
    left_out: list[str] = []
    _refuse_missing(path, "bytes", *_lengths(path))
    with TdmsFile.open(path) as file:
        groups = file.groups()
        channels = [channel for group in groups for channel in group.channels()]
        refuse_above(path, sum(8 * len(channel) for channel in channels), max_bytes)
        status = file.file_status
        for name, one in (status.channel_statuses or {}).items():
            _refuse_missing(path, f"values of {name}", one.expected_length, one.read_length)
        for group in groups:
            for channel in group.channels():
                name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
                values = np.asarray(channel[:]) if len(channel) else np.zeros(0)
                if values.dtype.kind not in "fiuM" or not len(values):
                    left_out.append(name)
                    continue
                series.append(_series(name, values, channel.properties))
    said = (f"Left out, without numbers: {', '.join(left_out[:8])}.",) * bool(left_out)
    if status.incomplete_final_segment:
        said += (f"{path.name} breaks off within its last segment; the rest was read.",)
    return Found(series, said)


def _lengths(path: Path) -> tuple[int, int]:
    """Return the length that the segments of a file state, and its own [bytes]."""
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at + _LEAD_IN.size <= size:
            file.seek(at)
            tag, _, _, length, _ = _LEAD_IN.unpack(file.read(_LEAD_IN.size))
            if tag != b"TDSm" or length == _INTERRUPTED:
                return size, size
            at += _LEAD_IN.size + length
    return at, size


def _refuse_missing(path: Path, what: str, stated: int, held: int) -> None:
    if stated - held > MOST_MISSING * held:
        raise RecordError(
            f"{path.name} states {stated:,} {what} and holds {held:,}: it is cut short or "
            "damaged. Get the original again."
        )


def _series(name: str, values: Any, properties: Any) -> Series:
    if values.dtype.kind == "M":
        stamps = values.astype("datetime64[ns]").astype(np.int64)
        return Series(name, stamps, stamps=True)
    unit = next((str(properties[key]) for key in _UNIT_KEYS if properties.get(key)), "")
    step = float(properties.get("wf_increment") or 0.0)
    start = properties.get("wf_start_time")
    start_ns = None
    if start is not None and step > 0.0:
        offset_ns = round(1e9 * float(properties.get("wf_start_offset") or 0.0))
        start_ns = int(np.datetime64(start, "ns").astype(np.int64)) + offset_ns
    return Series(name, values, unit, 1.0 / step if step > 0.0 else None, start_ns)
