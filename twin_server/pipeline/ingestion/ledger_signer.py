"""Signs heads of the ledger periodically, and publishes them on the bus.

Runs in the pipeline's own thread, between batches: the chains and the histories that one head
covers then belong to the same moment.
"""

import itertools
import json
from collections.abc import Callable, Iterator, Sequence

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Accepted, Branch, LedgerUpdate, SignedHead
from slowtime_schemas.streams import LEDGER
from slowtime_services.clock import Clock
from slowtime_services.credentials import Signer
from slowtime_services.ledger import Entry, Head, Leaf, Link, MerkleTree, headed
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import MOST_TOLD
from twin_server.persist import HeadRow, Store

from .estimation import NO_BOOT

LOOKED_BACK = 1_000
"""Heads that a server looks through when it starts, for what it has told of each twin."""
_LOW = (1 << 40) - 1

Publish = Callable[[str, bytes, str], None]


class LedgerSigner:
    """Signs heads over the chains of all twins of a store.

    Parameters
    ----------
    every_s
        At most one head in so many seconds.
    publish
        Told key, payload and encoding of what the bus is told.
    """

    def __init__(
        self, store: Store, clock: Clock, signer: Signer, every_s: float, publish: Publish
    ) -> None:
        self._store, self._clock, self._signer = store, clock, signer
        self._every_ns, self._publish = round(every_s * 1e9), publish
        self.merkle = MerkleTree()
        kept = [json.loads(row.body) for row in store.heads(limit=LOOKED_BACK, newest=True)]
        self.head = Head.of(kept[-1]["head"]) if kept else None
        leaves = (Leaf(*leaf) for one in kept for leaf in one["leaves"])
        self._told = {leaf.asset: leaf.length for leaf in leaves}
        self._sequence = 0

    def step(self) -> None:
        """Sign a head if the interval has passed and a chain has grown."""
        now_ns = self._clock.now_ns()
        if self.head is None or now_ns >= self.head.t_ns + self._every_ns:
            self.sign(now_ns)

    def sign(self, now_ns: int) -> Head | None:
        """Sign a head; return None where no chain has grown since the one before."""
        ends = self._store.ends()
        leaves = [leaf for leaf in map(self._leaf, ends, ends.values()) if leaf is not None]
        if not leaves:
            return None
        self.merkle.take(leaves)
        t_ns = max(now_ns, self.head.t_ns if self.head is not None else now_ns)
        head = headed(self.merkle.root, len(self.merkle.leaves), self.head, t_ns, self._signer)
        body = json.dumps({"head": head._asdict(), "leaves": leaves}, separators=(",", ":"))
        self._store.add_head(HeadRow(head.number, head.t_ns, body))
        self.head = head
        for leaf in leaves:
            self._tell(head, leaf)
        return head

    def _leaf(self, twin_id: str, end: Link) -> Leaf | None:
        """Return the leaf of a twin; None where its chain has not grown."""
        before = self.merkle.leaves.get(twin_id)
        if before is not None and before.end == end:
            return None
        digest, count = self._store.digest(twin_id)
        return Leaf(twin_id, end.length, end.digest.hex(), count, digest)

    def _tell(self, head: Head, leaf: Leaf) -> None:
        site, _, asset = leaf.asset.partition(".")
        since = self._told.get(leaf.asset, 0)
        if leaf.length - since > MOST_TOLD:
            since = leaf.length
        self._told[leaf.asset] = leaf.length
        self._sequence += 1
        message = LedgerUpdate(
            site=site,
            asset=asset,
            boot=NO_BOOT,
            sequence=self._sequence,
            t_ns=head.t_ns,
            count=leaf.length,
            link=leaf.link,
            history_count=leaf.history_count,
            history=leaf.history,
            accepted_after=since,
            accepted=tuple(accepted(self._store.entries(leaf.asset, since), self._boots())),
            proof=tuple(
                Branch(side=side, hash=other) for side, other in self.merkle.proof(leaf.asset)
            ),
            head=SignedHead(**head._asdict()),
        )
        self._publish(LEDGER.key(site, asset), encode(message), LEDGER.encoding)

    def _boots(self) -> dict[int, str]:
        return {run.number: run.boot for run in self._store.runs()[0]}


def accepted(entries: Sequence[Entry], boots: dict[int, str]) -> Iterator[Accepted]:
    """Write entries compactly: consecutive features of a boot as one range."""
    for _, group in itertools.groupby(
        enumerate(entries),
        lambda one: (
            one[1].kind,
            # Grows with the place among consecutive features, and stays if that is taken off.
            one[1].key - one[0] if one[1].kind == kinds.FEATURES else ("", one[0]),
        ),
    ):
        several = [entry for _, entry in group]
        first, last = several[0], several[-1]
        if first.kind == kinds.FEATURES:
            yield Accepted(
                kind=first.kind,
                boot=boots.get(first.key >> 40, ""),
                number=first.key >> 40,
                first=first.key & _LOW,
                last=last.key & _LOW,
            )
        else:
            yield Accepted(kind=first.kind, key=first.key, digest=first.digest.hex())
