"""Twins, the accounts of their boots, and events: how they are written."""

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from .checksums import EVENTS, RUNS, TWINS
from .counted import next_keys
from .levels import GrownBoot
from .rows import EventRow, FeatureRow, RunRow, TwinRow
from .statements import Connection, insert, rows_by_key, upsert


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


def write_runs(
    writer: Connection, runs: Sequence[RunRow], features: Sequence[FeatureRow]
) -> tuple[list[WrittenBoot], list[tuple[object, ...]]]:
    """Keep accounts, and of each boot whether slow time always rose: so it can be searched.

    Returns
    -------
    The boots in order, and how each has grown; and their rows.
    """
    times: dict[int, list[float]] = {}
    for feature in features:
        times.setdefault(feature.number, []).append(float(feature.slow_time))
    given = {run.number: run for run in runs}
    known = rows_by_key(writer, RUNS, list(given.keys() | times.keys()))
    rows, written = list[tuple[object, ...]](), []
    for number in sorted(given.keys() | times.keys()):
        before = known.get(number)
        last, rises = before[12:14] if before is not None else (None, 1)
        run = given[number] if number in given else RunRow(*known[number][:11])
        theirs = times.get(number)
        if theirs:
            rises = int(bool(rises) and (last is None or last <= theirs[0]) and _rise(theirs))
            last = theirs[-1]
        account = (*run[:9], int(run.closed), run.lost)
        twin_id = f"{run.site}.{run.asset}"
        rows.append((*account, twin_id, last, rises))
        grown = GrownBoot(number, -1 if before is None else before[6], run.last)
        written.append(WrittenBoot(twin_id, run.boot, grown))
    upsert(writer, RUNS, rows)
    return written, rows


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
