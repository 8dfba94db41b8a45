"""Compares the features of a recording with the signed ledger messages in it."""

import base64
import bisect
import contextlib
import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path

from slowtime_schemas.codec import Refused, decode_sample
from slowtime_schemas.messages import Accepted, Features, LedgerUpdate, SignedHead
from slowtime_schemas.streams import FEATURES, LEDGER
from slowtime_services.ledger import (
    Entry,
    Head,
    MerkleLeaf,
    beginning,
    chain,
    features_digest,
    linked,
    packed,
    proven,
    unpacked,
)

from .recording_reader import read_recording

PACKED = "w"
"""Kind of an item that holds entries of other rows than features."""


@dataclasses.dataclass
class LedgerCheck:
    """Result for one asset of a recording.

    Parameters
    ----------
    heads
        Signed heads that vouch for it.
    vouched
        Features that are, to the last bit, those that the server accepted.
    waiting
        Features of the recording that no head in it vouches for: before the first, or after
        the last.
    missing
        Features that the server accepted and the recording has not.
    has_kept
        Whether the head that was kept elsewhere is in it.
    wrong
        What has been changed, a sentence each; empty if nothing has.
    """

    heads: int = 0
    vouched: int = 0
    waiting: int = 0
    missing: int = 0
    has_kept: bool = False
    wrong: list[str] = dataclasses.field(default_factory=list)


def verdicts(
    path: Path | str, public: str | None = None, kept: Head | None = None
) -> dict[str, LedgerCheck]:
    """Compare a recording with the signed heads in it.

    Parameters
    ----------
    public
        Key of the server, from elsewhere; None to believe the one in the heads.
    kept
        A head that was kept elsewhere; one of its number has to be the same.

    Returns
    -------
    Of each asset that has features or heads in it.

    Raises
    ------
    RecordingError
        If it is no sound recording.
    """
    there: dict[str, dict[tuple[str, int], bytes]] = {}
    said: dict[str, list[LedgerUpdate]] = {}
    for message in read_recording(path, streams=[FEATURES, LEDGER]):
        try:
            read = decode_sample(message.key, message.payload)
        except Refused:
            continue
        if isinstance(read, LedgerUpdate):
            said.setdefault(read.twin_id, []).append(read)
        elif isinstance(read, Features):
            key = (read.boot, read.sequence)
            digest = features_digest(*key, read.t_ns, read.slow_time, message.payload)
            there.setdefault(read.twin_id, {}).setdefault(key, digest)
    keys = {read.head.public for of_asset in said.values() for read in of_asset}
    found = {}
    for asset in sorted(there.keys() | said.keys()):
        found[asset] = _verdict(there.get(asset, {}), said.get(asset, []), public)
        for head in {message.head for message in said.get(asset, [])}:
            if kept is not None and head.number == kept.number:
                found[asset].has_kept = is_same = Head(**head.model_dump()) == kept
                if not is_same:
                    found[asset].wrong.append(
                        f"head {kept.number} is another than the one that was kept elsewhere"
                    )
        if public is None and len(keys) > 1:
            found[asset].wrong.append(
                f"heads are signed with {len(keys)} keys; name the server's own with --key"
            )
    return found


class _Held:
    """Digests of the features of one asset that a recording holds."""

    def __init__(self, digests: dict[tuple[str, int], bytes]) -> None:
        self.digests = digests
        self._sequences: dict[str, list[int]] = {}
        for boot, sequence in sorted(digests):
            self._sequences.setdefault(boot, []).append(sequence)

    def between(self, boot: str, first: int, last: int) -> int:
        """Return how many of a boot there are from `first` to `last`."""
        held = self._sequences.get(boot, [])
        return max(0, bisect.bisect_right(held, last) - bisect.bisect_left(held, first))


def _verdict(
    digests: dict[tuple[str, int], bytes], said: list[LedgerUpdate], public: str | None
) -> LedgerCheck:
    found, there = LedgerCheck(), _Held(digests)
    before: LedgerUpdate | None = None
    vouched: set[tuple[str, int]] = set()
    heads: dict[int, SignedHead] = {}
    for message in sorted(said, key=lambda one: one.head.number):
        which = f"head {message.head.number}"
        if heads.setdefault(message.head.number, message.head) != message.head:
            found.wrong.append(f"there are two of {which}")
        elif (why := _why_not_signed(message, public)) is not None:
            found.wrong.append(f"{which} {why}")
        elif before is not None and message.count < before.count:
            found.wrong.append(f"{which} vouches for less than the one before it")
        else:
            found.heads += 1
            _follow(there, before, message, vouched, found)
            before = message
    found.vouched = len(vouched)
    found.waiting = len(digests.keys() - vouched)
    return found


def _why_not_signed(message: LedgerUpdate, public: str | None) -> str | None:
    head = Head(**message.head.model_dump())
    if not head.is_signed or head.public != (public or head.public):
        return "is not signed with the server's key"
    leaf = MerkleLeaf(
        message.twin_id,
        message.count,
        message.link,
        message.history_count,
        message.history,
        message.tree or "",
    )
    path = [(branch.side, bytes.fromhex(branch.hash)) for branch in message.proof]
    if proven(leaf.written, path).hex() != head.root:
        return "does not vouch for what it is said to"
    return None


def _follow(
    there: _Held,
    before: LedgerUpdate | None,
    message: LedgerUpdate,
    vouched: set[tuple[str, int]],
    found: LedgerCheck,
) -> None:
    """Chain rows accepted since the head before, from those that the recording holds.

    A server that was started again lists some of them once more; each is gone through once.
    """
    if before is None and message.accepted_after == 0:
        from_head = beginning(message.twin_id)
    elif before is not None and message.accepted_after <= before.count:
        from_head = MerkleLeaf(before.twin_id, before.count, before.link, 0, "").end
    else:
        return
    rows, which = sum(map(_count, message.accepted)), f"head {message.head.number}"
    if rows != message.count - message.accepted_after or rows > chain.MOST_TOLD:
        found.wrong.append(
            f"{which} lists {rows} rows; it vouches for {message.count} after "
            f"{message.accepted_after}, and {chain.MOST_TOLD} are listed at most"
        )
        return
    accepted = list(_after(message.accepted, from_head.length - message.accepted_after))
    features = [one for one in accepted if one.kind == chain.FEATURES]
    held = sum(there.between(one.boot, one.first, one.last) for one in features)
    missing = sum(map(_count, features)) - held
    found.missing += missing
    if missing:
        # Without one of them, what the others hash to cannot be told.
        return
    keys = [(one.boot, n) for one in features for n in range(one.first, one.last + 1)]
    entries = list(_entries(accepted, there))
    to_head = MerkleLeaf(message.twin_id, message.count, message.link, 0, "").end
    if linked(from_head, entries) != to_head:
        found.wrong.append(
            f"of what head {message.head.number} vouches for and none before it, something is "
            f"not as it was: {_named(keys)}"
        )
        return
    vouched.update(keys)


def _count(one: Accepted) -> int:
    """Return the number of rows that an item stands for."""
    if one.kind == PACKED:
        return len(_unpacked(one))
    return max(0, one.last - one.first + 1) if one.kind == chain.FEATURES else 1


def _unpacked(one: Accepted) -> list[Entry]:
    """Return the entries of an item of other rows than features; none if it is malformed."""
    with contextlib.suppress(ValueError):
        return unpacked(base64.b64decode(one.entries, validate=True))
    return []


def _after(accepted: Iterable[Accepted], count: int) -> Iterator[Accepted]:
    """Yield items without the first `count` rows that they stand for."""
    for one in accepted:
        rows = _count(one)
        if count < rows:
            yield _without(one, count)
        count = max(0, count - rows)


def _without(one: Accepted, count: int) -> Accepted:
    """Return an item without the first rows that it stands for."""
    if not count:
        return one
    if one.kind == PACKED:
        left = base64.b64encode(packed(_unpacked(one)[count:])).decode()
        return one.model_copy(update={"entries": left})
    return one.model_copy(update={"first": one.first + count})


def _entries(accepted: Iterable[Accepted], there: _Held) -> Iterator[Entry]:
    for one in accepted:
        if one.kind == chain.FEATURES:
            for sequence in range(one.first, one.last + 1):
                place = (one.number << 40) + sequence
                yield Entry(one.kind, place, there.digests[one.boot, sequence])
        elif one.kind == PACKED:
            yield from _unpacked(one)
        else:
            yield Entry(one.kind, one.key, bytes.fromhex(one.digest or ""))


def _named(keys: list[tuple[str, int]]) -> str:
    if not keys:
        return "no features are among it"
    boots = sorted({boot for boot, _ in keys})
    parts = []
    for boot in boots:
        theirs = [sequence for of, sequence in keys if of == boot]
        parts.append(f"features {min(theirs)} to {max(theirs)} of boot {boot}")
    return ", ".join(parts)
