"""The last seconds of raw samples, for those who ask: bounded in time and in bytes."""

import collections
import threading


class Ring:
    """Encoded raw blocks, oldest first out.

    Parameters
    ----------
    seconds
        How much of the stream is kept, by the sensor's clock.
    max_bytes
        Beyond which older blocks go, however short the time.
    """

    def __init__(self, seconds: float, max_bytes: int) -> None:
        self._kept_ns, self._max_bytes = round(seconds * 1e9), max_bytes
        self._blocks: collections.deque[tuple[int, bytes]] = collections.deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def put(self, end_ns: int, payload: bytes) -> None:
        """Keep a block that ends at `end_ns`; the newest one is always kept."""
        with self._lock:
            if self._blocks and end_ns < self._blocks[-1][0]:
                self._blocks.clear()  # the sensor's clock was set back: ages no longer compare
                self._bytes = 0
            self._blocks.append((end_ns, payload))
            self._bytes += len(payload)
            while len(self._blocks) > 1 and (
                self._bytes > self._max_bytes or self._blocks[0][0] <= end_ns - self._kept_ns
            ):
                self._bytes -= len(self._blocks.popleft()[1])

    def last(self, seconds: float) -> list[bytes]:
        """Blocks that reach into the last `seconds` of the stream, in order."""
        with self._lock:
            if not self._blocks:
                return []
            after = self._blocks[-1][0] - round(seconds * 1e9)
            return [payload for end_ns, payload in self._blocks if end_ns > after]

    @property
    def size(self) -> int:
        """Bytes held."""
        return self._bytes
