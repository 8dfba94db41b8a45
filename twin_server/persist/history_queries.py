"""Reads parts of a twin's history: between two times, whole or thinned."""

from collections.abc import Sequence

from twin_server.history.buckets import Buckets, thin
from twin_server.history.states import States, from_bytes

from .store import StoredHistory, ThinnedHistory
from .tables.checksums import FEATURES
from .tables.details import changes, column, has_details
from .tables.levels import coarse
from .tables.search import (
    SHIFT,
    Span,
    first_after,
    of_number,
    spans_by_slow_time,
    spans_by_time,
    whole,
)
from .tables.statements import Connection, select
from .tables.states import states_by_key, states_of_spans

_BETWEEN = "where id between ? and ?"

_BUCKETS_PER_POINT = 4
"""Buckets that are looked at for each point of a thinned history."""


def select_history(
    reader: Connection,
    twin_id: str,
    t_ns: tuple[int | None, int | None],
    slow_time: tuple[float | None, float | None],
    after: tuple[int, int] | None,
    limit: int | None,
    newest: bool,
) -> StoredHistory:
    """Read the states of a twin in order.

    Parameters
    ----------
    t_ns
        First and last sensor time [ns since 1970-01-01 UTC], both included; None for no bound.
    slow_time
        First and last slow time [unit of the boot], both included; None for no bound.
    after
        Boot number and sequence behind which states are read.
    limit, newest
        At most so many states: the first, or with `newest` the last ones.

    Returns
    -------
    States with the number of the boot of each, and details where there are any.
    """
    spans = whole(reader, twin_id)
    boots = {span.number: (span.boot, span.unit) for span in spans}
    spans = spans_by_time(reader, spans, *t_ns)
    spans = spans_by_slow_time(reader, spans, *slow_time)
    if after is not None:
        spans = [span.after(after[0] << SHIFT | after[1]) for span in spans]
    rows = states_of_spans(reader, spans, slow_time, limit, newest)
    return _history(
        reader, from_bytes(state for _, state in rows), [key for key, _ in rows], boots
    )


def select_thinned(
    reader: Connection,
    twin_id: str,
    max_points: int,
    t_ns: tuple[int | None, int | None],
    slow_time: tuple[float | None, float | None],
) -> ThinnedHistory:
    """Read at most `max_points` states of a twin, among them the extremes of all.

    Parameters
    ----------
    t_ns, slow_time
        As of `select_history`.

    Returns
    -------
    The states, and buckets of all states where these are more.
    """
    spans = whole(reader, twin_id)
    boots = {span.number: (span.boot, span.unit) for span in spans}
    ends = {span.number: span.last for span in spans}
    spans = spans_by_time(reader, spans, *t_ns)
    spans = spans_by_slow_time(reader, spans, *slow_time)
    coarsened = None
    if all(span.rises for span in spans):
        coarsened = coarse(reader, spans, ends, _BUCKETS_PER_POINT * max_points)
    if coarsened is not None and coarsened.head["count"].sum() <= max_points:
        # So sparse are the sequences that all states fit.
        coarsened = None
    if coarsened is not None:
        keys = coarsened.picked(max_points).tolist()
        rows = states_by_key(reader, keys)
        states = from_bytes(rows[key] for key in keys)
    else:
        states, keys, coarsened = _thinned_states(reader, spans, slow_time, max_points)
    history = _history(reader, states, keys, boots)
    bands = None if coarsened is None else coarsened.coarser(max(1, max_points // 2))
    return ThinnedHistory(history, bands)


def _thinned_states(
    reader: Connection,
    spans: Sequence[Span],
    slow_time: tuple[float | None, float | None],
    max_points: int,
) -> tuple[States, list[int], Buckets | None]:
    """Read all states and pick some; with their keys, and buckets where not all were picked."""
    every = states_of_spans(reader, spans, slow_time, None, False)
    states, keys = from_bytes(state for _, state in every), [key for key, _ in every]
    if len(states) <= max_points:
        return states, keys, None
    detailed = has_details(reader, keys)
    parameters = changes(reader, keys) if detailed else None
    bodies = column(reader, keys, "body") if detailed else ()
    buckets = Buckets.of_states(keys, states, parameters, bodies)
    kept = thin(states, max_points, parameters)
    return states[kept], [keys[i] for i in kept.tolist()], buckets


def _history(
    reader: Connection,
    states: States,
    keys: Sequence[int],
    boots: dict[int, tuple[str, str]],
) -> StoredHistory:
    bodies = column(reader, keys, "body") if has_details(reader, keys) else ()
    return StoredHistory(states, [key >> SHIFT for key in keys], boots, bodies)


def select_boots(reader: Connection, twin_id: str) -> list[tuple[int, bytes, int]]:
    """Read number, first message and sensor time of the last one of each boot with readings.

    Parameters
    ----------
    twin_id
        SITE.ASSET.
    """
    found = []
    for span in whole(reader, twin_id):
        between = (span.first, span.last)
        first = select(reader, FEATURES, _BETWEEN, between, 1)
        last = select(reader, FEATURES, _BETWEEN, between, 1, newest=True)
        if first:
            found.append((span.number, first[0][3], last[0][1]))
    return found


def select_neighbours(
    reader: Connection, number: int, t_ns: int
) -> tuple[bytes | None, bytes | None]:
    """Read the last message of a boot that ends by an instant, and the first one after it.

    Parameters
    ----------
    number
        Of the boot.
    t_ns
        The instant by sensor time [ns since 1970-01-01 UTC].
    """
    span = of_number(reader, number)
    if span is None:
        return None, None
    place = first_after(reader, span, t_ns)
    before = select(reader, FEATURES, _BETWEEN, (span.first, place - 1), 1, newest=True)
    after = select(reader, FEATURES, _BETWEEN, (place, span.last), 1)
    return before[0][3] if before else None, after[0][3] if after else None
