"""Accepted features of a run: their digest for acknowledgements, and whether others differ."""

import itertools
import time
from collections.abc import Callable, Iterator

from twin_server.collect import RepeatedFeatures, Run, StoreChange, contest_reading
from twin_server.persist import Store

from .rows import decoded
from .state_publisher import ACK_EVERY_S, AcknowledgedRange

MOST_INCLUDED = 10_000
"""Features of before that are taken into a digest; an agent compares as many of a boot."""

ROWS_OF_ONE = 500
"""Features that are read again for one asset in one round of acknowledgements: some 3 ms."""
ROWS_OF_ALL = 4_000
"""And for all assets together; the rest is read in the next rounds."""

NEAR = 4
"""Features that came again are read by one query where no more than so many lie between."""


class RangeProver:
    """Tells which range of a run to acknowledge, with the digest of what its agent still holds.

    After a start the digest of a run begins where its history ends, and says nothing of what
    the agent is about to delete; and what an agent holds of an earlier boot may end before the
    history does, if another agent has made that. So features are read again, a few in each
    round, that one asset does not hold up the others; a range is told once all are read.
    """

    def __init__(self, store: Store, now_s: Callable[[], float] = time.monotonic) -> None:
        self._store, self._now_s = store, now_s
        self._round_s = -ACK_EVERY_S
        self._left = 0
        self._served: set[tuple[str, str]] = set()

    def range_of(self, run: Run) -> AcknowledgedRange | None:
        """Return the range to acknowledge; None where more is to be read in another round."""
        if run.part is not None or 0 <= run.held_from <= run.held_to < run.next - 1:
            return self._earlier_range(run)
        if 0 <= run.held_from < run.stretch:
            begin = max(run.held_from, run.floor, run.stretch - MOST_INCLUDED)
            if not self._reach_back(run, run, begin):
                return None
        run.held_from = run.held_to = -1
        if run.last == run.next - 1 >= run.stretch:
            return AcknowledgedRange(run.last, run.stretch, run.digest)
        return AcknowledgedRange(run.next - 1, None, 0)

    def _earlier_range(self, run: Run) -> AcknowledgedRange | None:
        """Return a range that ends with what the agent holds, before the history does."""
        part = run.part
        if part is None:
            part = Run(run.site, run.asset, run.boot, number=run.number)
            part.stretch = run.held_to + 1
            part.held_from = max(run.held_from, part.stretch - MOST_INCLUDED)
            part.last = run.held_to
            run.part, run.held_from, run.held_to = part, -1, -1
        if not self._reach_back(run, part, part.held_from):
            return None
        run.part = None
        if part.stretch <= part.last:
            return AcknowledgedRange(part.last, part.stretch, part.digest)
        return self.range_of(run)

    def _reach_back(self, run: Run, digest: Run, begin: int) -> bool:
        """Extend a digest backwards to `begin`, or to a gap; False where some is left."""
        begin = max(begin, digest.floor)
        if digest.stretch <= begin:
            return True
        count = min(ROWS_OF_ONE, digest.stretch - begin, self._room(run))
        if count:
            first = digest.stretch - count
            digest.extend(accepted_messages(self._store, run, first, digest.stretch - 1))
            if digest.stretch > first:
                digest.floor = digest.stretch  # there is a gap
        return digest.stretch <= max(begin, digest.floor)

    def _room(self, run: Run) -> int:
        """How many features may be read now; an asset has one turn in each round."""
        now_s = self._now_s()
        if now_s - self._round_s >= ACK_EVERY_S:
            self._round_s, self._left = now_s, ROWS_OF_ALL
            self._served.clear()
        if (run.site, run.asset) in self._served or self._left <= 0:
            return 0
        self._served.add((run.site, run.asset))
        self._left -= ROWS_OF_ONE
        return ROWS_OF_ONE


def accepted_messages(store: Store, run: Run, first: int, last: int) -> list[tuple[int, bytes]]:
    """Read sequence and bytes of the accepted features `first` to `last` of a run."""
    return [
        (row.sequence, row.message) for row in store.messages_of_boot(run.number, first, last)
    ]


def contest_repeated(store: Store, change: StoreChange) -> None:
    """Compare features that came again with the kept ones; contest runs where they differ."""
    repeated: dict[Run, list[RepeatedFeatures]] = {}
    for one in change.repeated:
        repeated.setdefault(one.run, []).append(one)
    for run, again in repeated.items():
        kept: dict[int, bytes] = {}
        for first, last in _stretches(sorted({r.sequence for r in again})):
            kept |= accepted_messages(store, run, first, last)
        kept |= {o.features.sequence: o.payload for o in change.ordered if o.run is run}
        other = next((r for r in again if kept.get(r.sequence, r.payload) != r.payload), None)
        if other is None:
            continue
        one_ns, other_ns = decoded(kept[other.sequence]).t_ns, decoded(other.payload).t_ns
        contest_reading(run, other.sequence, one_ns, other_ns, change)


def _stretches(sequences: list[int]) -> Iterator[tuple[int, int]]:
    """First and last of each stretch of ascending sequences without a wide gap."""
    first = sequences[0]
    for before, after in itertools.pairwise(sequences):
        if after - before > NEAR:
            yield first, before
            first = after
    yield first, sequences[-1]
