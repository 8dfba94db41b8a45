"""Features in, messages out: kept on disk first, sent then, and sent again when asked for."""

from .publisher import Publisher, raw_message
from .ring import Ring
from .segment_files import SpoolError
from .spool import Spool, SpoolRange

__all__ = ["Publisher", "Ring", "Spool", "SpoolError", "SpoolRange", "raw_message"]
