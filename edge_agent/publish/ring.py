"""A ring of the newest raw samples, bounded in time and bytes."""

import collections
import threading
from typing import NamedTuple


class _KeptBlock(NamedTuple):
    end_ns: int
    length_ns: int
    payload: bytes


class Ring:
    """Encoded raw blocks, oldest first out.

    Seconds are those of samples: between the records of an intermittent sensor days may pass,
    and the last minute of samples is that of the last records all the same.
    """

    def __init__(self, seconds: float, max_bytes: int) -> None:
        self._kept_ns, self._max_bytes = round(seconds * 1e9), max_bytes
        self._blocks: collections.deque[_KeptBlock] = collections.deque()
        self._bytes = self._length_ns = 0
        self._lock = threading.Lock()

    def put(self, start_ns: int, end_ns: int, payload: bytes) -> None:
        """Keep a block from `start_ns` to `end_ns`; the newest one is always kept."""
        with self._lock:
            if self._blocks and end_ns < self._blocks[-1].end_ns:
                self._blocks.clear()  # the sensor's clock was set back: ages no longer compare
                self._bytes = self._length_ns = 0
            self._blocks.append(_KeptBlock(end_ns, end_ns - start_ns, payload))
            self._bytes += len(payload)
            self._length_ns += end_ns - start_ns
            while len(self._blocks) > 1 and (
                self._bytes > self._max_bytes
                or self._length_ns - self._blocks[0].length_ns >= self._kept_ns
            ):
                oldest = self._blocks.popleft()
                self._bytes -= len(oldest.payload)
                self._length_ns -= oldest.length_ns

    def last(self, seconds: float) -> list[bytes]:
        """Blocks that hold the last `seconds` of samples, in order."""
        left, found = round(min(seconds, 1e9) * 1e9), list[bytes]()
        with self._lock:
            for block in reversed(self._blocks):
                if left <= 0:
                    break
                found.append(block.payload)
                left -= block.length_ns
        return found[::-1]

    @property
    def size(self) -> int:
        """Bytes held."""
        return self._bytes
