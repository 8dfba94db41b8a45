"""A pyramid of buckets over each boot's states: 8, 64, 512 … sequences, kept as they fill.

A bucket is written in the transaction that fills it, out of those of the level below, so that
each state costs the same however long the history is. What has not filled yet is read from the
level below. A span of any length is so covered by a few hundred buckets.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from twin_server.history.buckets import Buckets
from twin_server.history.states import from_bytes

from .checksums import LEVELS, damaged, seal
from .details import changes, column, has_details
from .search import SHIFT, Span

BITS = 3
"""Binary logarithm of how many buckets of a level make one of the next."""

TOP = 7
"""Highest level; each of its buckets has 2^21 sequences."""

_AT_ONCE = 4_096
"""Features that are held in memory at once while buckets are built."""

_LOW = (1 << SHIFT) - 1


class GrownBoot(NamedTuple):
    """A boot that has grown: its number, and its last sequence before and now."""

    number: int
    before: int
    last: int


def extend(writer: Any, grown: Sequence[GrownBoot]) -> None:
    """Write all buckets that have filled."""
    for level in range(1, TOP + 1):
        filled = [
            (one.number << SHIFT | first, one.number << SHIFT | end - 1)
            for one in grown
            for first, end in [_filled(one, level)]
            if first < end
        ]
        if not filled:
            return
        for buckets in _below(writer, level, filled):
            if len(buckets):
                _insert(writer, level, buckets)


def build(writer: Any, number: int) -> None:
    """Write all buckets of a boot that has none."""
    before = -1
    question = "select id from features where id > ? and id <= ? order by id limit 1 offset ?"
    whole = (number << SHIFT) + _LOW
    while True:
        start = (number << SHIFT) + before
        row = writer.execute(question, (start, whole, _AT_ONCE - 1)).fetchone()
        if row is None:
            last = writer.execute(
                "select max(id) from features where id > ? and id <= ?", (start, whole)
            ).fetchone()[0]
            if last is not None:
                extend(writer, [GrownBoot(number, before, last & _LOW)])
            return
        extend(writer, [GrownBoot(number, before, row[0] & _LOW)])
        before = row[0] & _LOW


def delete_levels(writer: Any, spans: Iterable[Span]) -> None:
    """Drop all buckets of some boots."""
    for span in spans:
        for level in range(1, TOP + 1):
            writer.execute(
                "delete from levels where level = ? and id between ? and ?",
                (level, span.first, (span.number << SHIFT) + _LOW),
            )


def coarse(
    reader: Any, spans: Sequence[Span], ends: dict[int, int], most: int
) -> Buckets | None:
    """Cover spans by at most about `most` buckets; None where all states are no more.

    Parameters
    ----------
    ends
        Last id of each boot, by its number.
    """
    length = sum(span.last - span.first + 1 for span in spans)
    level = next((n for n in range(TOP + 1) if length >> BITS * n <= most), TOP)
    if not level:
        return None
    found = _covered(reader, spans, ends, level)
    while level and len(found) << BITS <= most:
        # Sequences may be sparse: there is room for a finer level.
        level -= 1
        found = _covered(reader, spans, ends, level)
    return found if level else None


def whole_states(reader: Any, first: int, last: int) -> Buckets:
    """Read states as buckets of one each."""
    rows = _state_rows(reader, first, last)
    keys = [row[0] for row in rows]
    states = from_bytes(row[1] for row in rows)
    if not has_details(reader, keys):
        return Buckets.of_states(keys, states)
    bodies = column(reader, keys, "body") or [None] * len(keys)
    return Buckets.of_states(keys, states, changes(reader, keys), bodies)


def _state_rows(reader: Any, first: int, last: int) -> list[tuple[int, bytes]]:
    rows = reader.execute(
        "select id, state, state_crc from features where id between ? and ? order by id",
        (first, last),
    ).fetchall()
    for key, state, crc in rows:
        if seal(key, state) != crc:
            raise damaged(f"The state of feature {key & _LOW} of boot number {key >> SHIFT}")
    return [(key, state) for key, state, _ in rows]


def _filled(one: GrownBoot, level: int) -> tuple[int, int]:
    """First sequence, and that after the last, of the buckets that one has filled."""
    bits = BITS * level
    return (one.before + 1) >> bits << bits, (one.last + 1) >> bits << bits


def _below(writer: Any, level: int, ranges: Sequence[tuple[int, int]]) -> Iterator[Buckets]:
    """Make buckets of a level out of the one below it."""
    parts: list[Buckets] = []
    held = 0
    for part in _finer(writer, level - 1, ranges):
        if held and (part.quantities.shape[1] != parts[-1].quantities.shape[1]):
            yield _grouped(parts, level)
            parts, held = [], 0
        parts.append(part)
        held += len(part)
        if held >= _AT_ONCE:
            yield _grouped(parts, level)
            parts, held = [], 0
    if held:
        yield _grouped(parts, level)


def _finer(reader: Any, level: int, ranges: Sequence[tuple[int, int]]) -> Iterator[Buckets]:
    """Read the buckets of ranges of ids; at level 0 states, those without details together."""
    rows: list[tuple[int, bytes]] = []
    for begin, end in _stretches(reader, level, ranges):
        if level:
            yield _read(reader, level, begin, end)
            continue
        detailed = has_details(reader, [begin, end])
        if not detailed:
            rows += _state_rows(reader, begin, end)
        if rows and (detailed or len(rows) >= _AT_ONCE):
            yield Buckets.of_states([key for key, _ in rows], from_bytes(s for _, s in rows))
            rows = []
        if detailed:
            yield whole_states(reader, begin, end)
    if rows:
        yield Buckets.of_states([key for key, _ in rows], from_bytes(s for _, s in rows))


def _stretches(
    reader: Any, level: int, ranges: Sequence[tuple[int, int]]
) -> Iterator[tuple[int, int]]:
    """Cut ranges of ids into parts that are read at once, without those that are empty."""
    bits = BITS * level
    size = _AT_ONCE << bits
    for first, last in ranges:
        if last - first < size:
            yield first, last
            continue
        begin = _next_key(reader, level, first, last)
        while begin is not None:
            # A boot's sequences may leap; the buckets of a leap are empty.
            begin = begin >> bits << bits
            end = min(begin + size - 1, last)
            yield begin, end
            begin = _next_key(reader, level, end + 1, last)


def _next_key(writer: Any, level: int, first: int, last: int) -> int | None:
    """Least id of a bucket of a level, or of a state at level 0, between two; None without."""
    table = "levels where level = ? and" if level else "features where"
    given = (level, first, last) if level else (first, last)
    question = f"select id from {table} id between ? and ? order by id limit 1"
    row = writer.execute(question, given).fetchone()
    return None if row is None else int(row[0])


def _grouped(parts: Sequence[Buckets], level: int) -> Buckets:
    fine = Buckets.joined(parts)
    group = fine.head["first"] >> BITS * level
    return fine.merged(np.flatnonzero(np.diff(group, prepend=-1)))


def _insert(writer: Any, level: int, buckets: Buckets) -> None:
    bits = BITS * level
    firsts = (buckets.head["first"] >> bits << bits).tolist()
    writer.executemany(
        "insert into levels (level, id, bucket, crc) values (?,?,?,?)",
        [
            LEVELS.sealed((level, first, body))
            for first, body in zip(firsts, buckets.to_bytes(), strict=True)
        ],
    )


def _read(reader: Any, level: int, first: int, last: int) -> Buckets:
    found = []
    for key, bucket, crc in reader.execute(
        "select id, bucket, crc from levels where level = ? and id between ? and ? order by id",
        (level, first, last),
    ):
        if seal(level, key, bucket) != crc:
            raise damaged(f"A bucket of level {level} at feature {key & _LOW}")
        found.append(bucket)
    return Buckets.from_bytes(found)


def _covered(reader: Any, spans: Sequence[Span], ends: dict[int, int], level: int) -> Buckets:
    return Buckets.joined(
        [
            part
            for span in spans
            for part in _cover(reader, span.first, span.last, ends[span.number], level)
            if len(part)
        ]
    )


def _cover(reader: Any, first: int, last: int, end: int, level: int) -> list[Buckets]:
    """Read one span: in its middle buckets of `level`, at its ends finer ones."""
    if first > last:
        return []
    if level == 0:
        return [whole_states(reader, first, last)]
    bits = BITS * level
    begin = (first + (1 << bits) - 1) >> bits << bits
    past = (min(last, end) + 1) >> bits << bits
    if begin >= past:
        return _cover(reader, first, last, end, level - 1)
    return [
        *_cover(reader, first, begin - 1, end, level - 1),
        _read(reader, level, begin, past - 1),
        *_cover(reader, past, last, end, level - 1),
    ]


def wrong_buckets(reader: Any, number: int, last: int) -> tuple[list[str], int]:
    """Compute the buckets of a boot again; return which differ, and how many there are.

    Levels are compared from the finest on, so that each is computed out of sound ones.

    Parameters
    ----------
    last
        Last sequence of the boot, lost ones included.
    """
    first = number << SHIFT
    newest = reader.execute(
        "select max(id) from features where id between ? and ?", (first, first + _LOW)
    ).fetchone()[0]
    kept = _kept(reader, number)
    count, wrong = len(kept), list[str]()
    one = GrownBoot(number, -1, last)
    for level in range(1, TOP + 1):
        begin, end = _filled(one, level)
        if begin >= end or wrong:
            break
        for start, body in _computed(reader, level, first | begin, first | end - 1):
            there = kept.pop((level, start), None)
            # Without its last features, which are lost, a bucket is not made by `build`.
            may_lack = newest is None or start + (1 << BITS * level) - 1 > newest
            if not (may_lack if there is None else _agree(there, body)):
                what = "is not there" if there is None else "does not follow from its states"
                wrong.append(f"the bucket of level {level} at feature {start & _LOW} {what}")
    if not wrong:
        wrong = [
            f"the bucket of level {level} at feature {start & _LOW} follows from no states"
            for level, start in kept
        ]
    return wrong, count


def _computed(reader: Any, level: int, first: int, last: int) -> Iterator[tuple[int, bytes]]:
    bits = BITS * level
    for buckets in _below(reader, level, [(first, last)]):
        if len(buckets):
            starts = (buckets.head["first"] >> bits << bits).tolist()
            yield from zip(starts, buckets.to_bytes(), strict=True)


def _agree(one: bytes, other: bytes) -> bool:
    """Whether two buckets say the same; parameters that one lacks are of no state there."""
    if one == other:
        return True
    try:
        both = Buckets.joined([Buckets.from_bytes([one]), Buckets.from_bytes([other])])
    except ValueError:
        return False
    first, second = both.to_bytes()
    return first == second


def _kept(reader: Any, number: int) -> dict[tuple[int, int], bytes]:
    first = number << SHIFT
    found = dict[tuple[int, int], bytes]()
    for level in range(1, TOP + 1):
        rows = reader.execute(
            "select id, bucket from levels where level = ? and id between ? and ?",
            (level, first, first + _LOW),
        )
        found |= {(level, key): body for key, body in rows}
    return found
