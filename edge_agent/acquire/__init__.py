"""First stage of the edge: a source in, admitted blocks out.

A source is anything that can be iterated for blocks; it yields None where an epoch is complete
and nothing more of it will come, so that its features need not wait for the next one. A live
sensor needs no class: its URL and the layout of its messages are settings (see `live`). What
no scheme reads is a class with `time_base`, `slow_time_unit` and an `__iter__` that yields
`Block`s, stamped with its own clock, ``first_index`` counting lost samples too.
"""

from .admission import ADOPT_AFTER, Admission, AdmissionState, Refusal
from .factory import check_input, open_source
from .live import COUNTERS, SCHEMES, LiveSource
from .source import BlockSource, CountingSource, Pacer

__all__ = [
    "ADOPT_AFTER",
    "COUNTERS",
    "SCHEMES",
    "Admission",
    "AdmissionState",
    "BlockSource",
    "CountingSource",
    "LiveSource",
    "Pacer",
    "Refusal",
    "check_input",
    "open_source",
]
