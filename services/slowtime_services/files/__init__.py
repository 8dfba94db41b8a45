"""Files of measurements in, records out: text of any kind, NumPy, MATLAB."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bridging import MARK, bridged
    from .conversion import Scaling, in_si, mixed_units, scaling_of
    from .read import MAX_BYTES, read_record
    from .record import UNDATED_NS, Gap, Record, RecordError, accelerations, find_column
    from .said import ALL
    from .stamps import DateOrder
    from .streaming import RecordStream, open_record, streams
    from .time_units import UNITS

_MODULES = {
    "bridging": ("MARK", "bridged"),
    "conversion": ("Scaling", "in_si", "mixed_units", "scaling_of"),
    "read": ("MAX_BYTES", "read_record"),
    "record": (
        "UNDATED_NS", "Gap", "Record", "RecordError", "accelerations", "find_column",
    ),
    "said": ("ALL",),
    "stamps": ("DateOrder",),
    "streaming": ("RecordStream", "open_record", "streams"),
    "time_units": ("UNITS",),
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
    "Record",
    "RecordError",
    "RecordStream",
    "Scaling",
    "accelerations",
    "bridged",
    "find_column",
    "in_si",
    "mixed_units",
    "open_record",
    "read_record",
    "scaling_of",
    "streams",
]


def __getattr__(name: str) -> Any:
    """Import a name where it is asked for: an edge beside a sensor reads no files."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
