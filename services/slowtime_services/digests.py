"""Digest of a range of features, by which two processes compare what they hold.

The digest of a range is the sum of the digests of its payloads, modulo 2⁶⁴. So a process that
keeps running sums can tell the digest of any range that begins and ends at places it knows.
"""

import hashlib

MODULUS = 2**64


def digest_of(sequence: int, payload: bytes) -> int:
    """Return the digest of one payload under its sequence.

    Examples
    --------
    >>> digest_of(1, b"a") == digest_of(2, b"a")
    False
    """
    key = sequence.to_bytes(8, "little")
    return int.from_bytes(hashlib.blake2b(payload, digest_size=8, key=key).digest(), "little")


def written(digest: int) -> str:
    """Write a digest as it travels: sixteen hexadecimal digits.

    Examples
    --------
    >>> written(255)
    '00000000000000ff'
    """
    return f"{digest % MODULUS:016x}"
