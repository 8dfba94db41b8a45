"""Accepted features of a run: their digest for acknowledgements, and whether others differ."""

from twin_server.collect import Change, RepeatedFeatures, Run, contest_reading
from twin_server.persist import Store

from .rows import decoded
from .state_publisher import AcknowledgedRange

MOST_INCLUDED = 10_000
"""Features of before that are taken into a digest; an agent compares as many of a boot."""


def acknowledged_range(store: Store, run: Run) -> AcknowledgedRange:
    """Return the range to acknowledge of a run, with the digest of what its agent still holds.

    After a start the digest of a run begins where its history ends, and says nothing of
    what the agent is about to delete; and what an agent holds of an earlier boot may end
    before the history does, if another agent has made that.
    """
    first, last = run.held_from, run.held_to
    run.held_from = run.held_to = -1
    if 0 <= first <= last < run.next - 1:
        part = Run(run.site, run.asset, run.boot, stretch=last + 1)
        part.extend(accepted_messages(store, run, max(first, last + 1 - MOST_INCLUDED), last))
        if part.stretch <= last:
            return AcknowledgedRange(last, part.stretch, part.digest)
    elif 0 <= first < run.stretch:
        begin = max(first, run.stretch - MOST_INCLUDED)
        run.extend(accepted_messages(store, run, begin, run.stretch - 1))
    if run.last == run.next - 1 >= run.stretch:
        return AcknowledgedRange(run.last, run.stretch, run.digest)
    return AcknowledgedRange(run.next - 1, None, 0)


def accepted_messages(store: Store, run: Run, first: int, last: int) -> list[tuple[int, bytes]]:
    """Read sequence and bytes of the accepted features `first` to `last` of a run."""
    rows = store.messages(f"{run.site}.{run.asset}", (run.number, first - 1), last + 1 - first)
    return [
        (row.sequence, row.message)
        for row in rows
        if row.number == run.number and row.sequence <= last
    ]


def contest_repeated(store: Store, change: Change) -> None:
    """Compare features that came again with the kept ones; contest runs where they differ."""
    repeated: dict[Run, list[RepeatedFeatures]] = {}
    for one in change.repeated:
        repeated.setdefault(one.run, []).append(one)
    for run, again in repeated.items():
        first, last = min(r.sequence for r in again), max(r.sequence for r in again)
        kept = dict(accepted_messages(store, run, first, min(last, first + MOST_INCLUDED)))
        kept |= {o.features.sequence: o.payload for o in change.ordered if o.run is run}
        other = next((r for r in again if kept.get(r.sequence, r.payload) != r.payload), None)
        if other is None:
            continue
        one_ns, other_ns = decoded(kept[other.sequence]).t_ns, decoded(other.payload).t_ns
        contest_reading(run, other.sequence, one_ns, other_ns, change)
