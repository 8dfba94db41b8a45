"""Binary universal files (dataset 58b), by pyuff."""

from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from slowtime_services.files.formats.universal import MARK, start_of
from slowtime_services.files.record import RecordError

from .found import Found, Series

TIME_RESPONSE = 1
_AXES = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}


def read(path: Path, max_bytes: int) -> Found:
    """Return a channel for each evenly spaced time response."""
    file = pyuff.UFF(str(path))
    kinds = np.atleast_1d(file.get_set_types())
    places = np.flatnonzero(kinds == 58).tolist()
    series, skipped = [], 0
    for number, place in enumerate(places):
        found = file.read_sets(place)
        found = found[0] if isinstance(found, list) else found
        values = np.asarray(found["data"])
        interval = float(found.get("abscissa_inc") or 0.0)
        even = int(found.get("abscissa_spacing", 1)) == 1 and interval > 0.0
        if int(found.get("num_pts", len(values))) != len(values):
            raise RecordError(
                f"A dataset 58 of {path.name} states {found['num_pts']} points and holds "
                f"{len(values)}: it is cut short, or was changed. Export it again."
            )
        if found.get("func_type") != TIME_RESPONSE or values.dtype.kind == "c" or not even:
            skipped += 1
            continue
        unit = str(found.get("ordinate_axis_units_lab") or "").strip()
        unit = "" if unit.upper() == "NONE" else unit
        name, start_ns = _name(found, number), start_of(str(found.get("id3") or ""))
        series.append(Series(name, values, unit, 1.0 / interval, start_ns))
    if not series:
        raise RecordError(
            f"{path.name} has no evenly spaced time response in a dataset 58 ({skipped} "
            "others). Export time histories, not spectra."
        )
    said = (f"{skipped} datasets that are no time responses were left out.",) * bool(skipped)
    return Found(series, said)


def _name(found: dict[str, Any], number: int) -> str:
    if str(found.get("id2") or "").strip() == MARK:
        return str(found.get("id1") or "").strip()
    node, direction = found.get("rsp_node"), found.get("rsp_dir")
    if node is None or direction is None:
        return f"response_{number}"
    return f"node {int(node)} {_AXES.get(int(direction), direction)}"
