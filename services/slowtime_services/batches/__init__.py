"""A folder of records → diagnoses of all of them, and one summary."""

from .cases import Case, cases_of
from .runs import CaseBatch, run_batch
from .summary import row_of, write_summary

__all__ = ["Case", "CaseBatch", "cases_of", "row_of", "run_batch", "write_summary"]
