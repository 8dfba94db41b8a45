"""Hash chain of an asset: each accepted row is hashed together with the row before it.

SHA-256 throughout. The chain of an asset begins at the hash of its name, so that none of its
links is one of another asset, and does not depend on in which table or shard it is kept.
"""

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

_BEGIN = b"slowtime ledger 1\n"
_BLOB = "blob "
"""Begins what is hashed of a blob: its own hash follows."""

FEATURES, REGISTRATION, ACKNOWLEDGEMENT, ASSET_EVENT = "f", "r", "a", "v"
ANEW = "e"
"""All states were estimated anew: a hash of the history from before is none of it now."""
DELETED = "d"
"""The twin was deleted with all it had seen; what follows is of one registered anew."""
STATES = "s"
"""States of the features of one boot from `key` on, up to the next such entry of the boot."""
BASIS = "b"
"""All rows are chained as they stand: what was chained before, features excepted, is void."""
SEAL = "z"
"""Authentication code of the server's key over the chain before; others cannot make it."""
GONE = bytes(hashlib.sha256().digest_size)
"""Digest of an entry that says that a row was removed."""


MOST_TOLD = 20_000
"""Entries of one twin that a message tells [1]; of more, only their end is told."""


class Entry(NamedTuple):
    """An accepted row: its kind, its number among these, and the hash of its content.

    Kinds are of one letter: see the constants of this module. Each table of the twin server
    that is covered has a letter of its own besides; a later entry of the same kind and key
    replaces an earlier one.
    """

    kind: str
    key: int
    digest: bytes

    @property
    def written(self) -> bytes:
        """Kind, key, hash: 41 bytes."""
        return self.kind.encode("ascii") + self.key.to_bytes(8, "big") + self.digest


WIDTH = 41
"""Bytes of an entry."""


class Link(NamedTuple):
    """End of a chain: how many entries it has, and the hash of all of them in their order."""

    length: int
    digest: bytes


def beginning(asset: str) -> Link:
    """Return the end of a chain that has no entry yet."""
    return Link(0, hashlib.sha256(_BEGIN + asset.encode()).digest())


def linked(link: Link, entries: Iterable[Entry]) -> Link:
    """Go on with some entries.

    Examples
    --------
    >>> one, other = (Entry("f", n, hashlib.sha256(b"%d" % n).digest()) for n in (1, 2))
    >>> begun = beginning("lab.beam")
    >>> linked(linked(begun, [one]), [other]) == linked(begun, [one, other])
    True
    >>> linked(begun, [other, one]).digest == linked(begun, [one, other]).digest
    False
    """
    return followed(link, packed(entries))


def followed(link: Link, block: bytes) -> Link:
    """Go on with entries that were packed."""
    digest = link.digest
    for at in range(0, len(block), WIDTH):
        digest = hashlib.sha256(digest + block[at : at + WIDTH]).digest()
    return Link(link.length + len(block) // WIDTH, digest)


def packed(entries: Iterable[Entry]) -> bytes:
    """Write entries one behind the other."""
    return b"".join(entry.written for entry in entries)


def unpacked(block: bytes) -> list[Entry]:
    """Read the output of `packed`.

    Raises
    ------
    ValueError
        If it is no whole number of entries.
    """
    if len(block) % WIDTH:
        raise ValueError(
            f"A block of {len(block)} bytes is no whole number of entries of {WIDTH}."
        )
    return [
        Entry(
            block[at : at + 1].decode("latin-1"),
            int.from_bytes(block[at + 1 : at + 9], "big"),
            block[at + 9 : at + WIDTH],
        )
        for at in range(0, len(block), WIDTH)
    ]


def features_digest(
    boot: str, sequence: int, t_ns: int, slow_time: float, message: bytes
) -> bytes:
    """Hash features in their transmitted form, with their key."""
    head = f"f {boot} {sequence} {t_ns} {slow_time!r}\n"
    return hashlib.sha256(head.encode() + message).digest()


def words_digest(kind: str, *words: str) -> bytes:
    """Hash some words, and where each ends."""
    text = "".join(f"{len(word.encode())}:{word}" for word in words)
    return hashlib.sha256(f"{kind} {text}".encode()).digest()


def row_digest(kind: str, row: Iterable[object]) -> bytes:
    """Hash a row of a table: its columns in their order, without checksums."""
    return words_digest(kind, *map(_word, row))


def key_of(*words: object) -> int:
    """Return the 7-byte key of a row whose own key is text or has several columns."""
    text = words_digest("key", *map(str, words)) if len(words) > 1 else str(words[0]).encode()
    found = text if len(words) > 1 else hashlib.sha256(text).digest()
    return int.from_bytes(found[:7], "big")


def states_digest(rows: Iterable[tuple[int, bytes, bytes, bytes]]) -> bytes:
    """Hash states: id of the feature, state, and both parts of its detail (empty: none)."""
    found = hashlib.sha256(b"s\n")
    for key, state, changes, body in rows:
        found.update(b"%d %d %d %d\n" % (key, len(state), len(changes), len(body)))
        found.update(state + changes + body)
    return found.digest()


def _word(value: object) -> str:
    if isinstance(value, bytes):
        return _BLOB + hashlib.sha256(value).hexdigest()
    if value is None:
        return "\0none"
    # SQLite keeps a text in a column of another type, so that one may look like a blob's hash.
    is_like_another = isinstance(value, str) and value.startswith((_BLOB, "\0"))
    return f"\0text {value}" if is_like_another else str(value)
