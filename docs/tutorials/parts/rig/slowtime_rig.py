"""A reader: files ``*.rig``, a line of JSON and then little-endian numbers of 4 bytes."""

import json
from pathlib import Path

import numpy as np

from slowtime_services.files.readers import Found
from slowtime_services.files.readers.found import Series


def read(path: Path, max_bytes: int) -> Found:
    """Give each channel with its unit, rate and start."""
    if path.stat().st_size > max_bytes:
        raise ValueError(f"it holds more than {max_bytes} bytes")
    heading, _, body = path.read_bytes().partition(b"\n")
    told = json.loads(heading)
    table = np.frombuffer(body, "<f4").reshape(-1, len(told["channels"]))
    series = [
        Series(name, column, told["unit"], told["rate_hz"], told.get("start_ns"))
        for name, column in zip(told["channels"], table.T, strict=True)
    ]
    return Found(series)
