"""Files of measurements in, records out: text of any kind, NumPy, MATLAB."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .channels.gap_filling import MARK, bridged
    from .channels.si_conversion import Scaling, in_si, mixed_units, scaling_of
    from .reading_options import ALL, MAX_BYTES, DateOrder, ReadingOptions, Repeated
    from .record import UNDATED_NS, Gap, Record, RecordError, accelerations, find_column
    from .record_part import part_of
    from .record_reader import read_record
    from .record_streams.record_stream import RecordStream, open_record, streams
    from .times.time_units import UNITS

_MODULES = {
    "channels.gap_filling": ("MARK", "bridged"),
    "channels.si_conversion": ("Scaling", "in_si", "mixed_units", "scaling_of"),
    "record_reader": ("read_record",),
    "record": (
        "UNDATED_NS", "Gap", "Record", "RecordError", "accelerations", "find_column",
    ),
    "record_part": ("part_of",),
    "reading_options": ("ALL", "MAX_BYTES", "DateOrder", "ReadingOptions", "Repeated"),
    "record_streams.record_stream": ("RecordStream", "open_record", "streams"),
    "times.time_units": ("UNITS",),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "ALL",
    "MARK",
    "MAX_BYTES",
    "UNDATED_NS",
    "UNITS",
    "DateOrder",
    "Gap",
    "ReadingOptions",
    "Record",
    "RecordError",
    "RecordStream",
    "Repeated",
    "Scaling",
    "accelerations",
    "bridged",
    "find_column",
    "in_si",
    "mixed_units",
    "open_record",
    "part_of",
    "read_record",
    "scaling_of",
    "streams",
]


def __getattr__(name: str) -> Any:
    """Import a name where it is asked for: an edge beside a sensor reads no files."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
