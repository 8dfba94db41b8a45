"""A database in; what of it is not as it was accepted out.

Checksums of rows detect decay, but a forger can recompute them. The forger cannot sign a head,
because the key is not in the database.
"""

from .audit import audit
from .result import Audit

__all__ = ["Audit", "audit"]
