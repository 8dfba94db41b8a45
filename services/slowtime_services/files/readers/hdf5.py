"""HDF5 files of any program, by h5py: datasets, and the meaning of their attributes."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from slowtime_services.files.binary.hdf5_objects import own_datasets, stored_bytes
from slowtime_services.files.binary.numpy_arrays import refuse_above
from slowtime_services.files.headings.vocabulary import FREQUENCY_UNITS, TIME_UNITS
from slowtime_services.files.record import RecordError

from .found import Figure, Found, Series

RATES = frozenset(
    "rate_hz rate fs f_s samplerate sample_rate sampling_rate samplingrate samplingfrequency "
    "sampling_frequency sample_frequency samplefrequency sampling_rate_hz sr "
    "frequency_hz".split()
)
INTERVALS = frozenset(
    "dt delta_t delta sample_interval sampling_interval dt_s increment wf_increment ts".split()
)
UNITS = ("unit", "units", "unit_string")
NAMES = ("channels", "channel_names", "columns", "names")


def read(path: Path, max_bytes: int) -> Found:
    """Return each dataset of numbers, a column of a table each.

    Rate, unit and names are looked for among the attributes of the dataset and of the groups
    it lies in, the nearest first, and among datasets of a single number.
    """
    series: list[Series] = []
    singles: dict[str, float] = {}
    figures: list[Figure] = []
    with h5py.File(path, "r") as file:
        found = [item for item in own_datasets(path, file) if _is_numeric(item)]
        refuse_above(path, sum(stored_bytes(item) for item in found), max_bytes)
        for item in found:
            name = item.name.strip("/")
            _refuse_unknown_filters(path, item)
            if item.size == 1:
                singles[name.rpartition("/")[2]] = float(np.asarray(item[()]).reshape(-1)[0])
                continue
            said = _said(item)
            figures += (Figure(hz, f"{key}:") for key, hz in _rates(said))
            series += _series(name, np.squeeze(np.asarray(item[()])), said)
    if len({one.name.rpartition("/")[0] for one in series}) == 1:
        series = [
            Series(one.name.rpartition("/")[2], one.values, one.unit, one.rate_hz, one.start_ns)
            for one in series
        ]
    figures += (
        Figure(hz, f"{key}:")
        for key, hz in _rates({name.casefold(): value for name, value in singles.items()})
    )
    of_singles = _rate({name.casefold(): value for name, value in singles.items()})
    if of_singles is not None:
        series = [
            Series(
                one.name, one.values, one.unit,
                of_singles if one.rate_hz is None else one.rate_hz, one.start_ns,
            )
            for one in series
        ]  # fmt: skip
    return Found(series, (), singles, tuple(dict.fromkeys(figures)))


def _refuse_unknown_filters(path: Path, item: Any) -> None:
    """Refuse a dataset compressed by a filter that this installation does not have."""
    plan = item.id.get_create_plist()
    for number in range(plan.get_nfilters()):
        code, _, _, said = plan.get_filter(number)
        if not h5py.h5z.filter_avail(code):
            name = said.decode(errors="replace").strip("\0") or "without a name"
            raise RecordError(
                f"Dataset {item.name} of {path.name} is compressed by the HDF5 filter {name} "
                f"({code}), which is not installed here; the file need not be damaged. Write "
                "it with gzip where that filter is installed: h5repack -f GZIP=4 IN OUT."
            )


def _is_numeric(item: Any) -> bool:
    return bool(item.dtype.kind in "fiub" and item.size and item.ndim <= 3)


def _said(item: Any) -> dict[str, Any]:
    """Attributes of a dataset and of all groups above it; the nearest count."""
    said: dict[str, Any] = {}
    while True:
        for name, value in item.attrs.items():
            said.setdefault(name.casefold(), value)
        if item.name in ("/", None):
            return said
        item = item.parent


def _rate(said: dict[str, Any]) -> float | None:
    return next((hz for _, hz in _rates(said)), None)


def _rates(said: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Rates that attributes state, under which name, rates before intervals."""
    for names, inverse in ((RATES, False), (INTERVALS, True)):
        for name, value in said.items():
            if name.replace(" ", "_") in names and np.size(value) == 1:
                try:
                    number = _number(value, TIME_UNITS if inverse else FREQUENCY_UNITS)
                except (TypeError, ValueError):
                    continue
                if 1e-12 < number < 1e12:
                    yield name, 1.0 / number if inverse else number


def _number(value: Any, units: Mapping[str, float]) -> float:
    """Value of an attribute that is a number, or a text of one, with or without its unit."""
    text = _texts(value)[0].strip()
    match = re.fullmatch(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(\D*)", text)
    if match is None or (match[2] and match[2].casefold() not in units):
        raise ValueError(text)
    return float(match[1]) * (units[match[2].casefold()] if match[2] else 1.0)


def _texts(value: Any) -> list[str]:
    many = np.atleast_1d(np.asarray(value)).reshape(-1).tolist()
    return [
        one.decode(errors="replace") if isinstance(one, bytes) else str(one) for one in many
    ]


def _series(name: str, values: Any, said: dict[str, Any]) -> list[Series]:
    rate = _rate(said)
    units = next((_texts(said[key]) for key in UNITS if key in said), [""])
    names = next((_texts(said[key]) for key in NAMES if key in said), [])
    if values.ndim == 1:
        return [Series(name, values, units[0], rate)]
    if values.ndim != 2:
        return []
    table = values if values.shape[0] >= values.shape[1] else values.T
    width = table.shape[1]
    folder = name.rpartition("/")[0]
    called = (
        [f"{folder}/{one}".strip("/") for one in names]
        if len(names) == width
        else [f"{name}_{i}" for i in range(width)]
    )
    each = units if len(units) == width else units[:1] * width
    return [Series(called[i], table[:, i], each[i], rate) for i in range(width)]
