"""Blocks in, mended and band-limited blocks out, with a count of what was mended."""

from .stage import CHUNK, Condition, Marked, Segment

__all__ = ["CHUNK", "Condition", "Marked", "Segment"]
