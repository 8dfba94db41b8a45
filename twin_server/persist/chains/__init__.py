"""Written rows in, entries of the ledger out: which chain covers a row, and how."""

from .coverage import COVERED, FOLLOWING, Coverage
from .journal import Journal

__all__ = ["COVERED", "FOLLOWING", "Coverage", "Journal"]
