"""Finds the features of a boot and of a time span within it, by bisection without an index."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .checksums import FEATURES, RUNS, opened
from .statements import select

SHIFT = 40
"""Bits of the sequence in a feature id; the boot number is above them."""

_SEQUENCE = (1 << SHIFT) - 1


class Span(NamedTuple):
    """Consecutive features of one boot, by their ids."""

    number: int
    boot: str
    unit: str
    rises: bool
    """Whether slow time never falls within the boot."""
    first: int
    last: int

    def after(self, key: int) -> "Span":
        """Keep the part behind the id `key`."""
        return self._replace(first=max(self.first, key + 1))


def whole(connection: Any, twin_id: str) -> list[Span]:
    """All of a twin's history."""
    return _spans(connection, "twin = ?", twin_id)


def of_number(connection: Any, number: int) -> Span | None:
    """All of one boot; None where there is none of that number."""
    return next(iter(_spans(connection, "number = ?", number)), None)


def grown_run(
    row: Sequence[Any], sequence: int, t_ns: int, slow_time: float
) -> tuple[Any, ...]:
    """Return the row of a boot that has grown by one more feature and not changed otherwise."""
    return (*row[:5], sequence + 1, sequence, t_ns, *row[8:12], slow_time, row[13])


def current_runs(reader: Any, rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Bring rows of boots up to date with their newest features.

    The row of a boot that only grows is behind its features (see `twins.RunWriter`).
    """
    found = []
    for row in rows:
        number, last, is_closed = row[0], row[6], row[9]
        if not is_closed:
            ids = (number << SHIFT) + last + 1, (number << SHIFT) + _SEQUENCE
            newest = select(reader, FEATURES, "where id between ? and ?", ids, 1, newest=True)
            for key, t_ns, slow_time, *_ in newest:
                row = grown_run(row, key & _SEQUENCE, t_ns, slow_time)
        found.append(tuple(row))
    return found


def first_after(connection: Any, span: Span, t_ns: int) -> int:
    """Least id in `span` of a later sensor time; one past its end if there is none."""
    return _where(connection, span, "t_ns", t_ns, inclusive=False)


def _spans(connection: Any, where: str, parameter: object) -> list[Span]:
    rows = connection.execute(
        f"select {', '.join(RUNS.all_columns)} from runs where {where} order by number",
        (parameter,),
    )
    current = current_runs(connection, opened(RUNS, rows))
    runs = [dict(zip(RUNS.columns, row, strict=True)) for row in current]
    return [
        Span(
            run["number"],
            run["boot"],
            run["slow_time_unit"],
            bool(run["slow_rises"]),
            run["number"] << SHIFT,
            (run["number"] << SHIFT) + run["last"],
        )
        for run in runs
    ]


def spans_by_time(
    connection: Any, spans: Sequence[Span], first: int | None, last: int | None
) -> list[Span]:
    """Keep the parts of `spans` from sensor time `first` to `last` [ns], both included."""
    return _narrowed(connection, spans, "t_ns", first, last)


def spans_by_slow_time(
    connection: Any,
    spans: Sequence[Span],
    first: float | None,
    last: float | None,
) -> list[Span]:
    """Keep the parts of `spans` within slow times; boots in which it falls stay whole."""
    if first is None and last is None:
        return [span._replace(rises=True) for span in spans]
    return [
        part
        for span in spans
        for part in (
            _narrowed(connection, [span], "slow_time", first, last) if span.rises else [span]
        )
    ]


def _narrowed(
    connection: Any,
    spans: Sequence[Span],
    column: str,
    first: float | None,
    last: float | None,
) -> list[Span]:
    narrowed = []
    for span in spans:
        begin, end = span.first, span.last
        if first is not None:
            begin = _where(connection, span, column, first, inclusive=True)
        if last is not None:
            end = _where(connection, span, column, last, inclusive=False) - 1
        if begin <= end:
            narrowed.append(span._replace(first=begin, last=end))
    return narrowed


def _where(connection: Any, span: Span, column: str, value: float, *, inclusive: bool) -> int:
    """Least id in `span` with `column` from `value` on, or above it; one past if none."""
    low, high = span.first, span.last + 1
    question = f"select id, {column} from features where id >= ? and id < ? order by id limit 1"
    while low < high:
        middle = (low + high) // 2
        found = connection.execute(question, (middle, high)).fetchone()
        if found is None or found[1] > value or (inclusive and found[1] == value):
            high = middle
        else:
            low = found[0] + 1
    return low
