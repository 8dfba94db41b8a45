"""Features in, messages out: kept on disk first, sent then, and sent again when asked for."""

from .publisher import Publisher, raw_message
from .ring import Ring
from .spool import Held, Spool, SpoolError

__all__ = ["Held", "Publisher", "Ring", "Spool", "SpoolError", "raw_message"]
