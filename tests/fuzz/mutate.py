"""Bytes that were good, made bad: bits, spans, lengths, and what JSON can say at its worst."""

import random
import re
from collections.abc import Sequence

WORST = (
    b"NaN", b"Infinity", b"-1", b"1e999", b"-0.0", b"1e-400", b"18446744073709551616",
    b"9223372036854775807", b"null", b"true", b'""', b"[]", b"{}", b'"\\u0000"', b'"\\ud800"',
    b"[" * 300, b'{"a":' * 300, b"\xff\xfe", b"\x00" * 16, b"0" * 400, b"'", b",", b"\r", b"/",
)  # fmt: skip
NUMBERS = (b"\x00\x00\x00\x00", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80")


def mutated(good: Sequence[bytes], rng: random.Random) -> bytes:
    """One of `good`, changed in up to eight places."""
    body = bytearray(rng.choice(good))
    for _ in range(rng.choice((0, 1, 1, 1, 2, 3, 8))):
        _change(body, good, rng)
    return bytes(body[: 1 << 20])


def _change(body: bytearray, good: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(body) + 1)
    end = min(len(body), at + (1 << rng.randrange(8)))
    kind = rng.randrange(12)
    if kind == 0 and at < len(body):
        body[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        body[at:end] = rng.randbytes(end - at)
    elif kind == 2:
        del body[at:end]
    elif kind == 3:
        body[at:at] = body[at:end] * rng.randrange(1, 5)
    elif kind == 4:
        body[at:end] = rng.choice(WORST)
    elif kind == 5:
        body[at : at + 4] = rng.choice(NUMBERS)
    elif kind == 6:
        del body[at:]
    elif kind == 7:
        other = rng.choice(good)
        where = rng.randrange(len(other) + 1)
        body[at:end] = other[where : where + 200]
    else:
        _value(body, rng)


def _value(body: bytearray, rng: random.Random) -> None:
    """Put something in the place of what stands after a colon, as JSON and YAML have it."""
    colons = [found.start() for found in re.finditer(b":", body)]
    if not colons:
        return
    begin = rng.choice(colons) + 1
    ends = [body.find(mark, begin) for mark in (b",", b"}", b"\n")]
    end = min((e for e in ends if e >= 0), default=len(body))
    body[begin:end] = rng.choice(WORST)
