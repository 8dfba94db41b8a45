"""Packs records of a spool segment, and finds valid records behind damage.

A segment holds eight bytes of mark, then records of

    length of payload (u32) · CRC-32 of sequence and payload (u32) · sequence (u64) · payload

little-endian. Where a record does not check, the next sound one is looked for byte by byte, and
the sequences in between are known to be damaged. The checksum does not cover the length, so a
record whose length alone is damaged is read whole, up to the next sound record.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

MARK = b"STSPOOL1"
RECORD = struct.Struct("<IIQ")
LARGEST_SEQUENCE = 2**40
"""Sequences are smaller, as the twin demands; their three upper bytes are zero."""
UNKNOWN_SIZE = 1024
"""Bytes of a record where none of a segment can be read: features of one mode or two."""
_ZEROS = b"\0\0\0"
_ZEROS_AT = RECORD.size - len(_ZEROS)
"""Where the zero bytes of a sequence stand in a record; text holds none, so they are rare."""


class Sound(NamedTuple):
    """A record that checks, from byte `begin` to before byte `end` of its segment."""

    begin: int
    end: int
    sequence: int
    payload: bytes


class Damage(NamedTuple):
    """Bytes that are no valid record, and the sequences that were in them.

    `last` is one less than `first` where no record was: damage to the mark, for instance. At
    the end of a segment `last` is estimated from what can still be read.
    """

    begin: int
    end: int
    first: int
    last: int


def pack(sequence: int, payload: bytes) -> bytes:
    """Make the record of one payload."""
    return RECORD.pack(len(payload), checksum(sequence, payload), sequence) + payload


def checksum(sequence: int, payload: bytes) -> int:
    """Return the CRC-32 of a record."""
    return zlib.crc32(payload, zlib.crc32(sequence.to_bytes(8, "little")))


def scan(data: bytes, first: int, following: int | None = None) -> Iterator[Sound | Damage]:
    """Read a segment from its beginning to its end, whatever has happened to it.

    `first` is the sequence that its first record was given, `following` the first one of the
    next segment of the same boot, where there is one.
    """
    at, due = len(MARK), first
    if not data.startswith(MARK):
        if _sound_at(data, at, due) is None:
            at = 0  # the mark is not only altered: records may begin anywhere
        else:
            yield Damage(0, at, due, due - 1)
    sizes: list[int] = []
    while at < len(data):
        record = _sound_at(data, at, due)
        if record is None:
            record = _next_sound(data, at + 1, due)
            before = len(data) if record is None else record.begin
            rescued = _of_damaged_length(data, at, before, due, record)
            if rescued is not None:
                record = rescued
            else:
                if record is not None:
                    last = record.sequence - 1
                elif following is not None:
                    last = following - 1
                else:
                    last = _last_within(data, at, due, sizes)
                yield Damage(at, before, due, last)
                due = last + 1
        if record is None:
            return
        yield record
        sizes.append(record.end - record.begin)
        at, due = record.end, record.sequence + 1
    if not sizes and following is not None and due == first:
        yield Damage(at, at, due, following - 1)


def _sound_at(data: bytes, at: int, due: int) -> Sound | None:
    if at + RECORD.size > len(data):
        return None
    length, check, sequence = RECORD.unpack_from(data, at)
    end = at + RECORD.size + length
    if end > len(data) or not due <= sequence < LARGEST_SEQUENCE:
        return None
    payload = data[at + RECORD.size : end]
    if checksum(sequence, payload) != check:
        return None
    return Sound(at, end, sequence, payload)


def _headers(data: bytes, at: int) -> Iterator[int]:
    """Yield the places from `at` on where a record might begin."""
    zeros = data.find(_ZEROS, at + _ZEROS_AT)
    while zeros >= 0:
        yield zeros - _ZEROS_AT
        zeros = data.find(_ZEROS, zeros + 1)


def _next_sound(data: bytes, at: int, due: int) -> Sound | None:
    candidates = (_sound_at(data, place, due) for place in _headers(data, at))
    return next((record for record in candidates if record is not None), None)


def _of_damaged_length(
    data: bytes, at: int, before: int, due: int, following: Sound | None
) -> Sound | None:
    """Read a record whose length alone is wrong, up to the beginning of the next one."""
    if before - at < RECORD.size:
        return None
    _, check, sequence = RECORD.unpack_from(data, at)
    most = LARGEST_SEQUENCE if following is None else following.sequence
    payload = data[at + RECORD.size : before]
    if not due <= sequence < most or checksum(sequence, payload) != check:
        return None
    return Sound(at, before, sequence, payload)


def _last_within(data: bytes, at: int, due: int, sizes: list[int]) -> int:
    """Estimate the last sequence in damaged bytes that nothing follows."""
    smallest = min(sizes, default=RECORD.size)
    typical = sum(sizes) // len(sizes) if sizes else UNKNOWN_SIZE
    last, since = due - 1, at
    # Headers that are still legible tell it; behind the last of them, and where there are none,
    # the size of the records before does.
    for place in _headers(data, at):
        length, _, sequence = RECORD.unpack_from(data, place)
        plausible = last < sequence <= due + 2 * (place - at) // smallest
        if plausible and (length or not sizes):
            last, since = sequence, place + typical
    unread = max(0, len(data) - since)
    least = 1 if last < due else 0
    return last + max(least, round(unread / typical))
