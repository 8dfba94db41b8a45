"""States of features: read by their keys or by spans of the history, and checked."""

from collections.abc import Iterator, Sequence

from .checksums import damaged, seal
from .search import SHIFT, Span
from .statements import ALL_ROWS, KEYS_PER_QUERY, Connection

_SEQUENCE = (1 << SHIFT) - 1


def states_by_key(reader: Connection, keys: Sequence[int]) -> dict[int, bytes]:
    """States of some keys, by them."""
    found: dict[int, bytes] = {}
    for first in range(0, len(keys), KEYS_PER_QUERY):
        asked = keys[first : first + KEYS_PER_QUERY]
        for key, state, crc in reader.execute(
            "select id, state, state_crc from features "
            f"where id in ({','.join('?' * len(asked))})",
            asked,
        ):
            if seal(key, state) != crc:
                raise damaged(
                    f"The state of feature {key & _SEQUENCE} of boot number {key >> SHIFT}"
                )
            found[key] = state
    if len(found) < len(keys):
        raise damaged("A bucket of states, or a state that it names,")
    return found


def states_of_spans(
    reader: Connection,
    spans: Sequence[Span],
    slow_time: tuple[float | None, float | None],
    limit: int | None,
    newest: bool,
) -> list[tuple[int, bytes]]:
    """Return ids and states of `spans` in order; unordered spans are filtered by slow time."""
    low, high = slow_time
    between = (-1e308 if low is None else low, 1e308 if high is None else high)
    rows: list[tuple[int, bytes]] = []
    for span in reversed(spans) if newest else spans:
        left = ALL_ROWS if limit is None else limit - len(rows)
        if left == 0 or span.last < span.first:
            continue
        found: Iterator[tuple[int, bytes, int]] = reader.execute(
            "select id, state, state_crc from features where id between ? and ? "
            + ("" if span.rises else "and slow_time >= ? and slow_time <= ? ")
            + f"order by id {'desc' if newest else 'asc'} limit ?",
            (span.first, span.last, *(() if span.rises else between), left),
        )
        for key, state, crc in found:
            if seal(key, state) != crc:
                raise damaged(f"The state of feature {key & _SEQUENCE} of boot {span.boot}")
            rows.append((key, state))
    return rows[::-1] if newest else rows
