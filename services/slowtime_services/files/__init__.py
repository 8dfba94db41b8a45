"""Files of measurements in, records out: text of any kind, NumPy, MATLAB."""

from .read import MAX_BYTES, read_record
from .record import UNDATED_NS, Gap, Record, RecordError, accelerations, find_column

__all__ = [
    "MAX_BYTES",
    "UNDATED_NS",
    "Gap",
    "Record",
    "RecordError",
    "accelerations",
    "find_column",
    "read_record",
]
