"""A bounded queue of messages between two threads; what it drops is counted."""

import collections
import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Inbox(Generic[T]):
    """A bounded queue between a thread of the bus and the thread that does the work.

    `put` never waits: where the inbox is full the newest item is refused and counted, since
    the bus would cut off a receiver that holds it up.

    Parameters
    ----------
    max_items, max_bytes
        What it holds at most; bytes as stated by the caller of `put`.

    Examples
    --------
    >>> inbox = Inbox(max_items=2)
    >>> [inbox.put(letter) for letter in "abc"]
    [True, True, False]
    >>> inbox.take(), inbox.dropped
    (['a', 'b'], 1)
    """

    def __init__(self, max_items: int = 100_000, max_bytes: int = 256 * 2**20) -> None:
        if max_items < 1 or max_bytes < 1:
            raise ValueError(
                f"An inbox of {max_items=}, {max_bytes=} could hold no message. Give positive "
                "numbers for both."
            )
        self._max_items, self._max_bytes = max_items, max_bytes
        self._items: collections.deque[T] = collections.deque()
        self._sizes: collections.deque[int] = collections.deque()
        self._bytes = 0
        self._dropped = 0
        self._closed = self._woken = False
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._waiting = 0

    def put(self, item: T, size: int = 0) -> bool:
        """Queue `item` for the worker; if the queue is full, count it and return False."""
        with self._lock:
            full = (
                len(self._items) >= self._max_items or self._bytes + size > self._max_bytes
            ) and self._items
            if full or self._closed:
                self._dropped += 1
                return False
            self._items.append(item)
            self._sizes.append(size)
            self._bytes += size
            # Waking a thread costs more than all the rest, so only a waiting one is woken.
            if self._waiting:
                self._changed.notify()
            return True

    def take(self, limit: int | None = None, timeout_s: float | None = 0.0) -> list[T]:
        """Up to `limit` items in order of arrival; waits for the first one up to `timeout_s`.

        None waits for as long as the inbox is open. `wake` ends the wait.
        """
        with self._lock:
            if not self._items and (timeout_s is None or timeout_s > 0):
                self._waiting += 1
                self._changed.wait_for(
                    lambda: self._items or self._closed or self._woken, timeout_s
                )
                self._waiting -= 1
            self._woken = False
            count = len(self._items) if limit is None else min(limit, len(self._items))
            self._bytes -= sum(self._sizes.popleft() for _ in range(count))
            return [self._items.popleft() for _ in range(count)]

    def wake(self) -> None:
        """End the wait of `take`, now or when it is called next, without an item."""
        with self._lock:
            self._woken = True
            self._changed.notify()

    def close(self) -> None:
        """Accept no more messages; those in the queue can still be taken."""
        with self._lock:
            self._closed = True
            self._changed.notify_all()

    @property
    def dropped(self) -> int:
        """Number of items dropped."""
        return self._dropped

    @property
    def closed(self) -> bool:
        """Whether nothing more can come."""
        return self._closed

    def __len__(self) -> int:
        return len(self._items)
