"""Bound on what a file may unpack to, by its own size.

A few kilobytes can unpack to gigabytes: deflated zeros, chunks that are stated and not stored,
counts in a heading. What is honest does not: records of measurements pack to a third or a
tenth of their size, as noise does not pack.
"""

import os
from pathlib import Path

from slowtime_services.files.record import RecordError

FREE_BYTES = 16 << 20
"""What any file may unpack to [bytes]: with the copies that reading makes, some 50 MiB."""

MOST_TIMES = 50
"""Times its own size that a larger file may unpack to [1]. Signals of one value in a thousand
samples pack to about a fiftieth; deflate ends at 1032, so that bombs are far beyond."""


def unpacked_bound(file_bytes: int, max_bytes: int | None = None) -> int:
    """Return what a file of so many bytes may unpack to [bytes]."""
    bound = max(FREE_BYTES, MOST_TIMES * file_bytes)
    return bound if max_bytes is None else min(bound, max_bytes)


def refuse_expansion(path: Path, size: int) -> None:
    """Refuse a file that unpacks to more than its own size explains.

    Raises
    ------
    RecordError
        Saying how large the file is, and what it holds.
    """
    own = os.path.getsize(path)
    if size > unpacked_bound(own):
        raise RecordError(
            f"{path.name} has {_size(own)} and states that it holds {_size(size)}, more than "
            f"{MOST_TIMES} times as much: it is damaged, or was made to fill memory. If it is "
            "right, save it without compression, or cut it into several files."
        )


def _size(count: float) -> str:
    if count < 1 << 20:
        return f"{count / 1024:.1f} KiB"
    return f"{count / 2**20:,.0f} MiB" if count < 1e15 else f"{count / 2**20:.1e} MiB"
