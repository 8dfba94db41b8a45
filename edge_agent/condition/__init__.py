"""Blocks in; bridged and band-limited blocks, with a count of bridged samples, out."""

from .stage import CHUNK, Conditioner, Marked, PendingSegment

__all__ = ["CHUNK", "Conditioner", "Marked", "PendingSegment"]
