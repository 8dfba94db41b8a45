"""Written rows in, entries of the ledger out: which table is covered how, and by which chain."""

from .coverage import COVERED, FOLLOWING, Coverage
from .journal import Journal

__all__ = ["COVERED", "FOLLOWING", "Coverage", "Journal"]
