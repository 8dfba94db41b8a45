"""Compares digests of one boot's features with those the twin accepted.

Another agent may send under the same asset and boot: a device that was cloned, or a boot id
that was fixed and used twice. Then an acknowledgement of its features must not clear ours.
"""

import threading
from array import array
from typing import Literal

from slowtime_services.digests import MODULUS, digest_of, written

MOST_SUMS = 1_000_000
"""Sums kept of what is not acknowledged, 8 bytes each; the oldest go first."""
MOST_STARTS = 16
"""Sums kept of where acknowledged ranges have begun."""

Verdict = Literal["agrees", "differs", "unknown"]


class DigestCheck:
    """Running sums of the digests of one boot's features.

    Features are noted by the thread that makes them, and compared by one of the bus.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._base = 0
        """Sequence of the first sum."""
        self._sums = array("Q")
        self._starts: dict[int, int] = {-1: 0}
        """Sum up to a sequence, where it may be asked for again."""

    @property
    def newest(self) -> int:
        """Newest sequence made; -1 before the first."""
        return self._base + len(self._sums) - 1

    def note(self, sequence: int, payload: bytes) -> None:
        """Add features that were made; sequences follow one another."""
        with self._lock:
            self._note(sequence, payload)

    def compare(self, first: int | None, last: int, digest: str | None) -> Verdict:
        """Compare the twin's digest of `first` to `last` with the features made."""
        with self._lock:
            return self._compare(first, last, digest)

    def _note(self, sequence: int, payload: bytes) -> None:
        before = self._sum_to(sequence - 1) if sequence == self.newest + 1 else None
        if before is None:  # a gap: sums begin anew, and no range across it can be told
            self._base, self._sums, self._starts = sequence, array("Q"), {sequence - 1: 0}
            before = 0
        self._sums.append((before + digest_of(sequence, payload)) % MODULUS)
        if len(self._sums) > MOST_SUMS:
            self._forget(self._base + MOST_SUMS // 2)

    def _compare(self, first: int | None, last: int, digest: str | None) -> Verdict:
        if last > self.newest:
            return "differs"
        if first is None or digest is None:
            return "unknown"
        before, after = self._sum_to(first - 1), self._sum_to(last)
        if before is None or after is None:
            return "unknown"
        if written(after - before) != digest:
            return "differs"
        self._starts[first - 1] = before
        self._starts[last] = after
        for old in list(self._starts)[:-MOST_STARTS]:
            del self._starts[old]
        self._forget(last)
        return "agrees"

    def _sum_to(self, sequence: int) -> int | None:
        if self._base <= sequence <= self.newest:
            return self._sums[sequence - self._base]
        return self._starts.get(sequence)

    def _forget(self, last: int) -> None:
        """Drop the sums up to `last`, but for the one there."""
        if last < self._base:
            return
        self._starts[last] = self._sums[last - self._base]
        del self._sums[: last - self._base + 1]
        self._base = last + 1
