"""Packets of transports, and the batches of samples that layouts decode from them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

UNIT_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds of each unit of stamps."""

Rows = Sequence[Sequence[float]] | np.ndarray
"""Numbers as the device sent them, one row a sample."""


class Packet(NamedTuple):
    """Bytes as they came: a message, or a piece of a stream without borders."""

    data: bytes
    arrival_ns: int
    topic: str = ""


class Batch(NamedTuple):
    """Samples that follow each other without a gap, one or many."""

    rows: Rows
    arrival_ns: int
    counter: int | None = None
    """Of the first sample or of the message, as the layout says; wraps at its width."""
    stamp: int | None = None
    """Device's time of the sample at `stamp_at`, in the unit of the layout."""
    stamp_at: int = 0
    lane: int = 0
    """Which group of channels it holds, where topics hold channels."""
    dropped: int = 0
    """How many samples the full queue has dropped right before it."""


class GarbledError(ValueError):
    """A message or line that does not match the layout."""
