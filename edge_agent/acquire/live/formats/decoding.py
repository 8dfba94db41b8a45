"""Decodes messages and lines to batches by a declared layout."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from edge_agent.acquire.live.batch import UNIT_NS, Batch, GarbledError, Rows
from edge_agent.layouts import CsvLayout, JsonLayout, PackedLayout
from slowtime_services.documents.json_documents import read_json

from .packed import decode_frame

MOST_SAMPLES = 1_000_000
"""Of one message; more are garbage."""

MOST_MESSAGE_BYTES = 2**24
"""Of one message, as of a `samples` message on the bus; a broker passes on 256 MiB."""

LAST_NS = 2**63
"""End of time in nanoseconds since 1970, in 2262, as messages and arrays hold it."""

LARGEST_COUNT = 2**64
"""Counters and stamps are smaller [1]: the widest that a device counts with has 64 bits."""

Decoder = Callable[[bytes, int], list[Batch]]
AnyLayout = JsonLayout | CsvLayout | PackedLayout


def decoder_of(layout: AnyLayout, lane: int = 0, columns: Sequence[int] = ()) -> Decoder:
    """Return the function that decodes a payload and its arrival time to batches.

    `lane` says which group of channels a payload holds, `columns` which channels those are;
    empty for all. It raises `GarbledError` where the payload is not what the layout declares.
    """
    places = tuple(columns) or tuple(range(len(layout.channels)))
    decode: Decoder
    if isinstance(layout, JsonLayout):
        decode = _JsonDecoder(layout, lane, places)
    elif isinstance(layout, CsvLayout):
        decode = _CsvDecoder(layout, lane, places)
    else:
        return lambda data, arrival_ns: [
            decode_frame(layout, data, arrival_ns)._replace(lane=lane)
        ]
    return lambda data, arrival_ns: _checked(decode, data, arrival_ns)


def bounded(decode: Decoder, layout: AnyLayout) -> Decoder:
    """Return the same decoder, which refuses counters and stamps that no device has."""
    unit_ns, is_utc = 1, False
    if layout.stamp is not None:
        unit_ns, is_utc = UNIT_NS[layout.stamp.unit], layout.stamp.clock == "utc"

    def decoded(data: bytes, arrival_ns: int) -> list[Batch]:
        if len(data) > MOST_MESSAGE_BYTES:
            raise GarbledError(f"More than {MOST_MESSAGE_BYTES:,} bytes.")
        batches = decode(data, arrival_ns)
        for batch in batches:
            # Counters and stamps become indices and times, which have 64 bits.
            if batch.counter is not None and abs(batch.counter) >= LARGEST_COUNT:
                raise GarbledError("Its counter has more than 64 bits.")
            if batch.stamp is None:
                continue
            if is_utc and not 0 <= batch.stamp * unit_ns < LAST_NS:
                raise GarbledError("Its stamp is before 1970, or after 2262.")
            if abs(batch.stamp) >= LARGEST_COUNT:
                raise GarbledError("Its stamp has more than 64 bits.")
        return batches

    return decoded


def _checked(decode: Decoder, data: bytes, arrival_ns: int) -> list[Batch]:
    try:
        return decode(data, arrival_ns)
    except GarbledError:
        raise
    except (
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        OverflowError,
        RecursionError,
    ) as error:
        raise GarbledError(f"{type(error).__name__}: {error}") from error


class _JsonDecoder:
    def __init__(self, layout: JsonLayout, lane: int, columns: tuple[int, ...]) -> None:
        self._lane = lane
        chosen = [layout.channels[n] for n in columns]
        self._paths = [_path(channel.at, channel.name) for channel in chosen]
        self._rows = None if layout.rows is None else layout.rows.split(".")
        self._counter = None if layout.counter is None else _path(layout.counter.at, "")
        self._stamp = None if layout.stamp is None else _path(layout.stamp.at, "")
        self._last = layout.stamp is not None and layout.stamp.of == "last"
        self._modulus = 2 ** (64 if layout.counter is None else layout.counter.bits)
        self._by_message = layout.counter is not None and layout.counter.counts == "messages"

    def __call__(self, data: bytes, arrival_ns: int) -> list[Batch]:
        told = read_json(data)
        parts = told if isinstance(told, list) else [told]
        batches = [batch for part in parts for batch in self._part(part, arrival_ns)]
        return _joined(batches) if self._by_message else batches

    def _part(self, part: Any, arrival_ns: int) -> list[Batch]:
        rows: Rows
        if self._rows is not None:
            rows = _matrix(_at(part, self._rows), len(self._paths))
        else:
            values = [_at(part, path) for path in self._paths]
            if not isinstance(values[0], list):
                # Quick: this is how most boards send.
                rows = [[_number(value) for value in values]]
            else:
                rows = _matrix(values, None).T
        counters = None if self._counter is None else _at(part, self._counter)
        stamps = None if self._stamp is None else _at(part, self._stamp)
        if not isinstance(counters, list) and not isinstance(stamps, list):
            at = len(rows) - 1 if self._last else 0
            counter = None if counters is None else _integer(counters)
            stamp = None if stamps is None else _integer(stamps)
            return [Batch(rows, arrival_ns, counter, stamp, at, self._lane)]
        return split(
            rows, _each(counters, len(rows)), _each(stamps, len(rows)), arrival_ns,
            self._modulus, self._lane, by_message=self._by_message,
        )  # fmt: skip


class _CsvDecoder:
    def __init__(self, layout: CsvLayout, lane: int, columns: tuple[int, ...]) -> None:
        self._lane, self._delimiter = lane, layout.delimiter
        self._counter, self._stamp, channels = layout.places
        self._channels = [channels[n] for n in columns]
        self._modulus = 2 ** (64 if layout.counter is None else layout.counter.bits)
        self._by_message = layout.counter is not None and layout.counter.counts == "messages"

    def __call__(self, data: bytes, arrival_ns: int) -> list[Batch]:
        rows, counters, stamps = [], [], []
        for line in data.decode("ascii").splitlines():
            if not line.strip():
                continue
            cells = line.split(None if self._delimiter == " " else self._delimiter)
            rows.append([float(cells[n]) for n in self._channels])
            if self._counter is not None:
                counters.append(_whole_number(cells[self._counter]))
            if self._stamp is not None:
                stamps.append(_whole_text(cells[self._stamp]))
        if not rows:
            raise GarbledError("It has no line of numbers.")
        return split(
            rows, counters or None, stamps or None, arrival_ns, self._modulus, self._lane,
            by_message=self._by_message,
        )  # fmt: skip


def split(
    rows: Any,
    counters: Sequence[int] | None,
    stamps: Sequence[int] | None,
    arrival_ns: int,
    modulus: int,
    lane: int,
    *,
    by_message: bool = False,
) -> list[Batch]:
    """Cut rows with a counter each where it does not go on by one; with stamps alone, each."""
    if len(rows) == 1 or (counters is None and stamps is None):
        return [
            Batch(
                rows,
                arrival_ns,
                counters[0] if counters else None,
                stamps[0] if stamps else None,
                0,
                lane,
            )
        ]
    # A counter of messages is the same in all rows of a message: rows are cut where it changes.
    goes_on = 0 if by_message else 1
    cuts = [
        n
        for n in range(1, len(rows))
        if counters is None or (counters[n] - counters[n - 1]) % modulus != goes_on
    ]
    return [
        Batch(
            rows[begin:end],
            arrival_ns,
            counters[begin] if counters else None,
            stamps[begin] if stamps else None,
            0,
            lane,
        )
        for begin, end in zip([0, *cuts], [*cuts, len(rows)], strict=True)
    ]


def _joined(batches: Sequence[Batch]) -> list[Batch]:
    """Join batches in a row that have the same counter of messages."""
    joined = []
    for _, group in itertools.groupby(batches, key=lambda batch: batch.counter):
        first, *others = group
        rows = [first.rows, *(batch.rows for batch in others)]
        joined.append(first._replace(rows=np.concatenate(rows)) if others else first)
    return joined


def _path(place: str | int | None, otherwise: str) -> list[str]:
    return (otherwise if place is None else str(place)).split(".")


def _at(told: Any, path: Sequence[str]) -> Any:
    for part in path:
        told = told[int(part)] if isinstance(told, list) else told[part]
    return told


def _number(value: Any) -> float:
    if value is None:
        return float("nan")  # a missing value, as JSON has no NaN
    if type(value) not in (int, float):
        raise GarbledError(f"{value!r:.40} is not a number.")
    return float(value)


def _matrix(values: Any, columns: int | None) -> np.ndarray:
    if not isinstance(values, list) or not all(isinstance(row, list) for row in values):
        raise GarbledError("Some channels are arrays and some are not.")
    rows = [[_number(value) for value in row] for row in values]
    lengths = {len(row) for row in rows}
    if len(lengths) != 1 or 0 in lengths or (columns is not None and lengths != {columns}):
        raise GarbledError(f"Arrays of {sorted(lengths)} numbers.")
    if max(len(rows), *lengths) > MOST_SAMPLES:
        raise GarbledError(f"More than {MOST_SAMPLES:,} samples.")
    return np.array(rows)


def _integer(value: Any) -> int:
    if type(value) is int:
        return value
    if type(value) is float and value.is_integer():
        return int(value)
    raise GarbledError(f"{value!r:.40} is not a whole number.")


def _whole_number(text: str) -> int:
    """Read a counter; as a float, one of 64 bits would lose its last digits."""
    try:
        return int(text)
    except ValueError:
        return _integer(float(text))


def _whole_text(text: str) -> int:
    """Read a stamp; as a float, nanoseconds since 1970 would lose their last digits."""
    try:
        return int(text)
    except ValueError:
        return round(float(text))


def _each(values: Any, count: int) -> list[int] | None:
    if values is None:
        return None
    if not isinstance(values, list) or len(values) != count:
        raise GarbledError(f"A counter or stamp for each of {count} samples was expected.")
    return [_integer(value) for value in values]
