"""Windows of time that an asset's earlier boots have measured: refused, or counted in part.

The same samples are sent again under another boot where an agent reads a file twice, or where
it loses its spool and starts again from a device's memory. A window with the start and the end
of one that is in the history is the same measurement, whatever it says. A window that overlaps
others is kept, with the share of its time that they have covered.

Boots follow each other, so that a reading is compared with earlier boots only, and only where
it begins before their end: an asset whose time goes on costs one comparison of numbers.
"""

import bisect
import collections
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from slowtime_schemas.messages import Features
from twin_server.collect import Ordered, Run
from twin_server.persist import Store

from .rows import decoded

MOST_ASSETS = 1_000
"""Assets whose earlier boots are remembered, those needed last; a read of a row for each boot
finds them again."""

MOST_BOOTS = 16
"""Boots that are searched for what overlaps one window; more at once can only be a window so
long that these cover it. Each costs two bisections of the boot."""


class Neighbours(NamedTuple):
    """The windows of one boot about an instant, by their ends."""

    before: Features | None
    """The last that ends by then."""
    after: Features | None
    """The first that ends later."""


class EarlierBoot(Protocol):
    """Windows of one boot that has ended, ascending in time."""

    start_ns: int
    end_ns: int

    def about(self, t_ns: int) -> Neighbours:
        """Find the windows about an instant."""
        ...


class Overlap(NamedTuple):
    """What one window shares with those of earlier boots.

    Parameters
    ----------
    covered
        Share of its time [1].
    same
        The window of the same start and end; None where there is none.
    boot
        Name of the boot that overlaps it; empty where none does.
    """

    covered: float
    same: Features | None = None
    boot: str = ""


class Repeated(NamedTuple):
    """A reading of a window that is in the history, and the reading that is."""

    again: Ordered
    first: Features


class SortedWindows(NamedTuple):
    """Readings, by whether their time was measured before.

    Parameters
    ----------
    new
        Those that are new at least in part, with their covered share.
    repeated
        Those of windows that are in the history.
    overlapped
        For each boot, its first reading that a boot before overlaps, and the name of that.
    """

    new: list[Ordered]
    repeated: list[Repeated]
    overlapped: dict[Run, tuple[Features, str]]


class WindowCoverage:
    """Compares windows with those of earlier boots of their assets."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._known: collections.OrderedDict[tuple[str, str], tuple[int, list[EarlierBoot]]] = (
            collections.OrderedDict()
        )

    def sort(self, ordered: Sequence[Ordered]) -> SortedWindows:
        """Sort readings, which are in order, by whether their time was measured before."""
        found = SortedWindows([], [], {})
        arrived: dict[tuple[str, str], dict[Run, list[Features]]] = {}
        for one in ordered:
            start_ns, end_ns = one.features.start_ns, one.features.t_ns
            batch = arrived.setdefault((one.run.site, one.run.asset), {})
            over = Overlap(0.0)
            if start_ns <= one.run.before_ns:
                over = self._overlap(one, batch)
            if over.same is not None:
                found.repeated.append(Repeated(one, over.same))
                continue
            if over.boot:
                found.overlapped.setdefault(one.run, (one.features, over.boot))
            own = [(start_ns, one.previous_ns)] if one.previous_ns > start_ns else []
            covered = max(over.covered, _share(start_ns, end_ns, own))
            found.new.append(one._replace(covered=covered) if covered else one)
            batch.setdefault(one.run, []).append(one.features)
        for key, batch in arrived.items():
            if len(batch) > 1:
                # The earlier of them is longer in the store from now on than was read there.
                self._known.pop(key, None)
        return found

    def _overlap(self, one: Ordered, batch: dict[Run, list[Features]]) -> Overlap:
        features = one.features
        start_ns, end_ns = features.start_ns, features.t_ns
        boots = [
            boot
            for boot in (
                *self._stored(one.run),
                *(_InBatch(kept) for run, kept in batch.items() if run is not one.run),
            )
            if boot.start_ns <= end_ns and boot.end_ns >= start_ns
        ]
        parts, name = list[tuple[int, int]](), ""
        for boot in boots[-MOST_BOOTS:]:
            since, until = boot.about(start_ns), boot.about(end_ns)
            if (same := _same(features, since, until)) is not None:
                return Overlap(1.0, same)
            if (part := _part(features, since, until)) is not None:
                parts.append(part)
                name = (since.after or since.before or features).boot
        return Overlap(_share(start_ns, end_ns, parts), None, name) if parts else Overlap(0.0)

    def _stored(self, run: Run) -> list[EarlierBoot]:
        """Boots before `run` in the store, in order."""
        key = run.site, run.asset
        known = self._known.get(key)
        if known is None or known[0] != run.number:
            known = run.number, _boots_before(self._store, run)
            self._known[key] = known
            while len(self._known) > MOST_ASSETS:
                self._known.popitem(last=False)
        self._known.move_to_end(key)
        return known[1]


class _Stored:
    """An earlier boot in the store."""

    def __init__(self, store: Store, number: int, start_ns: int, end_ns: int) -> None:
        self._store, self._number = store, number
        self.start_ns, self.end_ns = start_ns, end_ns

    def about(self, t_ns: int) -> Neighbours:
        """Bisect the boot for the windows about an instant."""
        before, after = self._store.neighbours(self._number, t_ns)
        return Neighbours(
            None if before is None else decoded(before),
            None if after is None else decoded(after),
        )


class _InBatch:
    """Readings of an earlier boot that become durable with the same batch."""

    def __init__(self, kept: Sequence[Features]) -> None:
        self._kept = kept
        self.start_ns, self.end_ns = kept[0].start_ns, kept[-1].t_ns

    def about(self, t_ns: int) -> Neighbours:
        """Bisect the list for the windows about an instant."""
        place = bisect.bisect_right(self._kept, t_ns, key=lambda one: one.t_ns)
        after = self._kept[place] if place < len(self._kept) else None
        return Neighbours(self._kept[place - 1] if place else None, after)


def _boots_before(store: Store, run: Run) -> list[EarlierBoot]:
    return [
        _Stored(store, number, decoded(first).start_ns, end_ns)
        for number, first, end_ns in store.boots(f"{run.site}.{run.asset}")
        if number < run.number
    ]


def _is_real(features: Features) -> bool:
    """Whether its clock is that of the structure; a simulator's own is another."""
    return features.time_base != "simulated"


def _same(features: Features, since: Neighbours, until: Neighbours) -> Features | None:
    """Return the window with the same start and end, by the same clock."""
    for other in (until.before, since.after):
        if (
            other is not None
            and (other.start_ns, other.t_ns) == (features.start_ns, features.t_ns)
            and _is_real(other) == _is_real(features)
        ):
            return other
    return None


def _part(features: Features, since: Neighbours, until: Neighbours) -> tuple[int, int] | None:
    """Return the time of a window that one boot covers, gaps within included."""
    first, last = since.after, until.before
    if first is None or _is_real(first) != _is_real(features):
        return None
    begins_ns = max(features.start_ns, first.start_ns)
    ends_ns = last.t_ns if last is not None else begins_ns
    if until.after is not None and until.after.start_ns <= features.t_ns:
        ends_ns = features.t_ns
    return (begins_ns, ends_ns) if begins_ns <= features.t_ns and ends_ns > begins_ns else None


def _share(start_ns: int, end_ns: int, parts: Sequence[tuple[int, int]]) -> float:
    """Return the share of a time that intervals within it cover together [1]."""
    if end_ns <= start_ns:
        return 1.0 if parts else 0.0
    covered, reached = 0, start_ns
    for begins_ns, ends_ns in sorted(parts):
        covered += max(0, min(ends_ns, end_ns) - max(begins_ns, reached))
        reached = max(reached, ends_ns)
    return covered / (end_ns - start_ns)
