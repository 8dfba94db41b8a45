"""Orders, reports and messages set aside in, and how a store keeps them out."""

from .kept_records import SqlRecords

__all__ = ["SqlRecords"]
