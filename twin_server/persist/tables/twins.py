"""Twins, the accounts of their boots, and events: how they are written."""

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from .checksums import EVENTS, RUNS, TWINS
from .counted import next_keys
from .levels import GrownBoot
from .rows import EventRow, FeatureRow, RunRow, TwinRow
from .search import current_runs, grown_run
from .statements import Connection, insert, rows_by_key, upsert

GROWTH = 64
"""Sequences by which a boot grows until its row is written: a start reads one feature of each
boot in any case, and one row in so many costs a hundredth of a feature."""


class WrittenBoot(NamedTuple):
    """A boot that was written: of which twin, its name, and how it has grown."""

    twin_id: str
    boot: str
    grown: GrownBoot


def write_twins(
    writer: Connection, twins: Sequence[TwinRow]
) -> tuple[dict[str, str], list[tuple[object, ...]]]:
    """Store twins; return the registrations that have changed, by twin, and all rows."""
    if not twins:
        return {}, []
    newest = {twin.id: twin for twin in twins}
    known = rows_by_key(writer, TWINS, list(newest))
    places = {key: row[1] for key, row in known.items()}
    if len(places) < len(newest):
        last = writer.execute("select coalesce(max(place), 0) from twins").fetchone()[0]
        following = itertools.count(last + 1)
        places |= {key: next(following) for key in newest if key not in places}
    rows: list[tuple[object, ...]] = [(key, places[key], *twin) for key, twin in newest.items()]
    upsert(writer, TWINS, rows)
    changed = {
        key: twin.registration
        for key, twin in newest.items()
        if key not in known or known[key][4] != twin.registration
    }
    return changed, rows


class RunWriter:
    """Writes accounts of boots, and of each whether slow time always rose, for searches.

    The row of a boot that only grows is written once in `GROWTH` sequences: what it would say
    follows from the features behind it (`search.current_runs`). So a batch of many assets
    writes their features and hardly any other row.
    """

    def __init__(self) -> None:
        self._current: dict[int, tuple[Any, ...]] = {}

    def forget(self) -> None:
        """Forget all rows: the last write may not have become durable."""
        self._current.clear()

    def write(
        self, writer: Connection, runs: Sequence[RunRow], features: Sequence[FeatureRow]
    ) -> tuple[list[WrittenBoot], list[tuple[Any, ...]]]:
        """Keep accounts that do not follow from features.

        Returns
        -------
        The boots in order, and how each has grown; and the rows that were written.
        """
        given = {run.number: run for run in runs}
        appended: dict[int, list[FeatureRow]] = {}
        for feature in features:
            appended.setdefault(feature.number, []).append(feature)
        numbers = sorted(given.keys() | appended.keys())
        unknown = [number for number in numbers if number not in self._current]
        kept = list(rows_by_key(writer, RUNS, unknown).values())
        self._current |= {row[0]: row for row in current_runs(writer, kept)}
        rows, written = list[tuple[Any, ...]](), []
        for number in numbers:
            before, theirs = self._current.get(number), appended.get(number, ())
            row = _run_row(before, given.get(number), theirs)
            if not _follows(row, before, theirs):
                rows.append(row)
            self._current[number] = row
            grown = GrownBoot(number, -1 if before is None else before[6], row[6])
            written.append(WrittenBoot(row[11], row[3], grown))
        upsert(writer, RUNS, rows)
        return written, rows


def _run_row(
    before: tuple[Any, ...] | None, run: RunRow | None, features: Sequence[FeatureRow]
) -> tuple[Any, ...]:
    """Return the row of a boot with its new account, if there is one, and new features."""
    slow_last, rises = (None, 1) if before is None else before[12:]
    if run is not None:
        account = (*run[:9], int(run.closed), run.lost, f"{run.site}.{run.asset}")
    else:
        assert before is not None  # features come with the account of their boot
        account = before[:12]
    if features:
        times = [float(feature.slow_time) for feature in features]
        begin = times[0] if slow_last is None else slow_last
        rises, slow_last = int(bool(rises) and _rise([begin, *times])), times[-1]
    return (*account, slow_last, rises)


def _follows(
    row: tuple[Any, ...], before: tuple[Any, ...] | None, features: Sequence[FeatureRow]
) -> bool:
    """Whether a row need not be written, because `search.current_runs` gives it."""
    if before is None or not features:
        return row == before
    newest = features[-1]
    grown = grown_run(before, newest.sequence, newest.t_ns, float(newest.slow_time))
    return row == grown and not row[9] and row[6] // GROWTH == before[6] // GROWTH


def _rise(times: Sequence[float]) -> bool:
    return all(a <= b for a, b in itertools.pairwise(times))


def insert_events(
    writer: Connection, events: Sequence[EventRow]
) -> list[tuple[int, str, str, str, int, float | None, int, str]]:
    """Keep events under the next numbers of their twins, and return their rows."""
    if not events:
        return []
    twins = [f"{event.site}.{event.asset}" for event in events]
    following = {
        twin: iter(keys) for twin, keys in next_keys(writer, EVENTS, Counter(twins)).items()
    }
    rows = [
        (
            next(following[twin]),
            twin,
            e.site,
            e.asset,
            e.t_ns,
            e.slow_time,
            int(e.derived),
            e.body,
        )
        for twin, e in zip(twins, events, strict=True)
    ]
    insert(writer, EVENTS, rows)
    return rows
