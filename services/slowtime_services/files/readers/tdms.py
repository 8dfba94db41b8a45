"""TDMS files of National Instruments, by npTDMS."""

from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from slowtime_services.files.binary.numpy_arrays import refuse_above

from .found import Found, Series

_UNIT_KEYS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units")


def read(path: Path, max_bytes: int) -> Found:
    """Return each channel of numbers; its name with its group's where there are several."""
    series: list[Series] = []
    left_out: list[str] = []
    with TdmsFile.open(path) as file:
        groups = file.groups()
        channels = [channel for group in groups for channel in group.channels()]
        refuse_above(path, sum(8 * len(channel) for channel in channels), max_bytes)
        for group in groups:
            for channel in group.channels():
                name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
                values = np.asarray(channel[:]) if len(channel) else np.zeros(0)
                if values.dtype.kind not in "fiuM" or not len(values):
                    left_out.append(name)
                    continue
                series.append(_series(name, values, channel.properties))
    said = (f"Left out, without numbers: {', '.join(left_out[:8])}.",) * bool(left_out)
    return Found(series, said)


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
