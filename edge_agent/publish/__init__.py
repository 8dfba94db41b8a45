"""Features in, messages out: kept on disk first, sent then, and sent again when asked for."""

from .publisher import Publisher, raw_message
from .ring import Ring
from .segment_files import SpoolError
from .spool import Held, Spool

__all__ = ["Held", "Publisher", "Ring", "Spool", "SpoolError", "raw_message"]
