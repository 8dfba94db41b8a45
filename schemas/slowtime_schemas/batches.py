"""Packs several messages into one payload, and unpacks the very same bytes.

Messages of one agent differ in their numbers only. So the text between the numbers is stored
once, and the numbers column by column: equal ones once, whole numbers as differences, others as
they were written. All of it is JSON, compressed with DEFLATE (RFC 1951) behind four bytes of
mark, of which the last is the version of the form. Nothing is converted to binary floating
point, so that any payload comes back byte for byte, whoever wrote it.
"""

import itertools
import json
import logging
import re
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic_core import from_json

logger = logging.getLogger(__name__)

MARK = b"STB\x01"
"""First bytes of a batch; JSON begins with none of them."""

BATCH_ENCODING = "application/x-slowtime-batch"
"""Media type of a batch."""

MOST_MESSAGES = 2_000
"""Messages of one batch."""
MOST_BYTES = 8 * 2**20
"""Bytes of all messages of a batch, so that a small payload does not fill the memory."""

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_LONGEST_INTEGER = 19
"""Characters of a number that is stored as a difference: more than any 63 bits need."""
_RAW_DEFLATE = -15


class BatchError(ValueError):
    """A batch that cannot be packed or unpacked."""


def is_batch(payload: bytes) -> bool:
    """Whether a payload is a batch of messages.

    Examples
    --------
    >>> is_batch(pack([b"{}"])), is_batch(b"{}")
    (True, False)
    """
    return payload[: len(MARK)] == MARK


def pack(payloads: Sequence[bytes]) -> bytes:
    """Pack messages, in their order.

    Raises
    ------
    BatchError
        Where there are more than `MOST_MESSAGES`, or more than `MOST_BYTES`.

    Examples
    --------
    >>> unpack(pack([b'{"t":1,"f":3.50}', b'{"t":2,"f":3.49}']))
    [b'{"t":1,"f":3.50}', b'{"t":2,"f":3.49}']
    """
    size = sum(map(len, payloads))
    if len(payloads) > MOST_MESSAGES or size > MOST_BYTES:
        raise BatchError(
            f"{len(payloads)} messages of {size:,} bytes were given. Allowed: up to "
            f"{MOST_MESSAGES} of {MOST_BYTES:,} bytes. Pack them in several batches."
        )
    numbers: dict[tuple[str, ...], list[list[str]]] = {}
    order = []
    for payload in payloads:
        text = tuple(_NUMBER.sub(b"\0", payload).decode("latin-1").split("\0"))
        found = [number.decode("ascii") for number in _NUMBER.findall(payload)]
        if len(text) != len(found) + 1:  # a zero byte of its own
            text, found = (payload.decode("latin-1"),), []
        numbers.setdefault(text, []).append(found)
        order.append(text)
    places = {text: place for place, text in enumerate(numbers)}
    content = {
        "order": _column([str(places[text]) for text in order]),
        "texts": list(numbers),
        "columns": [
            [_column(column) for column in zip(*rows, strict=True)] for rows in numbers.values()
        ],
    }
    plain = json.dumps(content, separators=(",", ":"), ensure_ascii=False).encode()
    deflate = zlib.compressobj(9, zlib.DEFLATED, _RAW_DEFLATE, 9)
    return MARK + deflate.compress(plain) + deflate.flush()


def unpack(batch: bytes) -> list[bytes]:
    """Return the messages of a batch, byte for byte as they were packed.

    Raises
    ------
    BatchError
        Where the batch is damaged, of a newer form, or larger than allowed.
    """
    if not is_batch(batch):
        raise BatchError(f"{bytes(batch[:4])!r} does not begin a batch. Send what pack makes.")
    try:
        return _unpacked(from_json(_inflated(batch)))
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, zlib.error) as error:
        raise BatchError(
            f"A batch of {len(batch):,} bytes cannot be unpacked: {error}. Send what pack "
            "makes."
        ) from error


def unpacked_or_whole(batch: bytes) -> list[bytes]:
    """Return the messages of a batch; a damaged one as it is, for its reader to refuse."""
    try:
        return unpack(batch)
    except BatchError as error:
        logger.warning("A batch is left as it is. %s", error)
        return [batch]


def _inflated(batch: bytes) -> bytes:
    inflate = zlib.decompressobj(_RAW_DEFLATE)
    plain = inflate.decompress(batch[len(MARK) :], MOST_BYTES)
    if not inflate.eof or inflate.unused_data:
        raise ValueError("it is cut short, too long or followed by other bytes")
    return plain


def _unpacked(content: dict[str, Any]) -> list[bytes]:
    order = [int(place) for place in _numbers(content["order"])]
    texts = [tuple(text) for text in content["texts"]]
    counts = [0] * len(texts)
    for place in order:
        if place < 0:
            raise ValueError("a text of negative place is named")
        counts[place] += 1
    rows = [
        zip(*(_numbers(column, count) for column in columns), strict=True)
        if columns
        else iter([()] * count)
        for columns, count in zip(content["columns"], counts, strict=True)
    ]
    left, messages = MOST_BYTES, []
    for place in order:
        message = _joined(texts[place], next(rows[place], ()))
        left -= len(message)
        if left < 0:
            raise ValueError(f"its messages have more than {MOST_BYTES:,} bytes")
        messages.append(message)
    return messages


def _joined(text: tuple[str, ...], numbers: Sequence[str]) -> bytes:
    if len(text) != len(numbers) + 1:
        raise ValueError(f"{len(numbers)} numbers do not fit between {len(text)} texts")
    pieces = [text[0]]
    for number, following in zip(numbers, text[1:], strict=True):
        pieces += number, following
    return "".join(pieces).encode("latin-1")


def _column(numbers: Sequence[str]) -> list[Any]:
    """Write numbers as one that they all equal, as differences, or as they are."""
    if numbers and numbers.count(numbers[0]) == len(numbers):
        return ["=", numbers[0], len(numbers)]
    if all(_is_integer(number) for number in numbers):
        values = list(map(int, numbers))
        steps = [after - before for before, after in itertools.pairwise(values)]
        return ["+", *values[:1], *steps]
    return [" ", " ".join(numbers)]


def _numbers(column: Sequence[Any], count: int | None = None) -> list[str]:
    """Read what `_column` has written; of `count` numbers where that is known."""
    kind, content = column[0], column[1:]
    if kind == "=":
        given = content[1] if count is None else count
        if not 0 <= given <= MOST_MESSAGES:
            raise ValueError(f"{given} numbers are stated; allowed are {MOST_MESSAGES}")
        numbers = [str(content[0])] * given
    elif kind == "+":
        numbers = list(map(str, _sums(content)))
    elif kind == " ":
        numbers = content[0].split(" ")
    else:
        raise ValueError(f"a column of kind {kind!r:.20} is not known")
    if len(numbers) > MOST_MESSAGES or count not in (None, len(numbers)):
        raise ValueError(f"a column of {len(numbers)} numbers is not as long as the others")
    return numbers


def _sums(steps: Iterable[int]) -> Iterable[int]:
    total = 0
    for step in steps:
        total += step
        yield total


def _is_integer(number: str) -> bool:
    """Whether a whole number is written as Python writes it."""
    digits = number.removeprefix("-")
    plain = digits.isdigit() and len(digits) <= _LONGEST_INTEGER
    return plain and str(int(number)) == number
