"""Blocks in; bridged and band-limited blocks, with a count of bridged samples, out."""

from .stage import CHUNK, Condition, Marked, Segment

__all__ = ["CHUNK", "Condition", "Marked", "Segment"]
