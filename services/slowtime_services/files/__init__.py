"""Files of measurements in, records out: text of any kind, NumPy, MATLAB."""

from .bridging import MARK, bridged
from .conversion import in_si, mixed_units
from .read import ALL, MAX_BYTES, read_record
from .record import UNDATED_NS, Gap, Record, RecordError, accelerations, find_column
from .stamps import DateOrder
from .time_units import UNITS

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
    "accelerations",
    "bridged",
    "find_column",
    "in_si",
    "mixed_units",
    "read_record",
]
