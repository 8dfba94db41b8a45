"""Files of measurements in, records out: text of any kind, NumPy, MATLAB."""

from .bridging import MARK, bridged
from .read import ALL, MAX_BYTES, read_record
from .record import UNDATED_NS, Gap, Record, RecordError, accelerations, find_column
from .stamps import DateOrder
from .streaming import RecordStream, open_record, streams
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
    "RecordStream",
    "accelerations",
    "bridged",
    "find_column",
    "open_record",
    "read_record",
    "streams",
]
