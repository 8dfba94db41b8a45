"""Records in, files of other programs out: CSV, Parquet, universal files (58b)."""

from .tables import write_csv, write_parquet
from .universal import write_universal

__all__ = ["write_csv", "write_parquet", "write_universal"]
