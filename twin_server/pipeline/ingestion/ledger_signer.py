"""Signs heads of the ledger periodically, and publishes them on the bus.

Runs in the pipeline's own thread, between batches: the chains and the histories that one head
covers then belong to the same moment.
"""

import base64
import itertools
import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Accepted, Branch, LedgerUpdate, SignedHead
from slowtime_schemas.streams import LEDGER
from slowtime_services.clock import Clock
from slowtime_services.credentials import Signer
from slowtime_services.ledger import (
    CompactRange,
    Entry,
    Head,
    Link,
    MerkleLeaf,
    MerkleTree,
    TreeHead,
    beginning,
    headed,
    linked,
    packed,
    tree_head,
)
from slowtime_services.ledger import chain as kinds
from slowtime_services.ledger.chain import MOST_TOLD
from twin_server.persist import Audit, HeadRow, Store
from twin_server.settings import LedgerSettings

from .estimation import NO_BOOT
from .repeated_audit import RepeatedAudit, audit_store

logger = logging.getLogger(__name__)

MOST_NAMED = 5
"""Differences that a refusal names; `slowtime db check --ledger` tells all."""
MOST_TWINS_TOLD = 1_000
"""Twins that get an event of a refusal; all of a larger site are wrong for one reason."""
_CURE = (
    "Keep the database aside as evidence, and restore the last backup that "
    "`slowtime db check --ledger` finds sound."
)
LOOKED_BACK = 1_000
"""Heads that a server looks through when it starts, for what it has told of each twin."""
_LOW = (1 << 40) - 1

Publish = Callable[[str, bytes, str], None]


class Witness(Protocol):
    """Keeps heads where the server's machine cannot change them."""

    @property
    def last(self) -> Head | None:
        """The last head that was kept; None where none was, or it cannot be read back."""
        ...

    @property
    def failures(self) -> int:
        """Attempts that failed."""
        ...

    def take(self, head: Head) -> None:
        """Keep one more, without waiting."""
        ...

    def close(self) -> None:
        """Wait a moment for what is on its way, and end."""
        ...


class LedgerSigner:
    """Signs heads over the chains of all twins of a store, as long as the store is proven.

    Before the first signature all rows are compared with the last signed head, and what lies
    behind it with the seals of the server's key. Before each further one, the blocks that were
    chained since are read back and compared with what the server chained.

    Parameters
    ----------
    publish
        Told key, payload and encoding of what the bus is told.
    witness
        Keeps heads elsewhere; told each that is signed.
    """

    def __init__(
        self,
        store: Store,
        clock: Clock,
        signer: Signer,
        settings: LedgerSettings,
        publish: Publish,
        witness: Witness | None = None,
    ) -> None:
        self._store, self._clock, self._signer = store, clock, signer
        self._settings, self._publish, self._witness = settings, publish, witness
        self._every_ns = round(settings.every_s * 1e9)
        self.merkle = MerkleTree()
        self.head: Head | None = None
        self._signed: dict[str, tuple[MerkleLeaf, int]] = {}
        self.refusal = ""
        """Why nothing is signed any more; empty if all is well."""
        self._unsaid: dict[str, str] = {}
        self._proven: dict[str, tuple[Link, CompactRange]] = {}
        kept = [json.loads(row.body) for row in store.heads(limit=LOOKED_BACK, newest=True)]
        leaves = (MerkleLeaf(*leaf) for one in kept for leaf in one["leaves"])
        self._told = {leaf.asset: leaf.length for leaf in leaves}
        self._sequence = 0
        self._repeated = RepeatedAudit(store, signer, settings.audit_every_s)
        self._begin()
        head = self.head
        self._signed_ns: int | None = None if head is None else head.t_ns

    def step(self) -> None:
        """Sign a head if the interval has passed and a chain has grown."""
        now_ns = self._clock.now_ns()
        self._repeated.step()
        if (found := self._repeated.take_result()) is not None:
            self._refuse_where_wrong(found)
        # Also where the clock was set back: the last head may lie years ahead.
        if self._signed_ns is None or abs(now_ns - self._signed_ns) >= self._every_ns:
            if self.sign(now_ns) is not None:
                self._signed_ns = now_ns

    def close(self) -> None:
        """Sign once more, and end what runs beside."""
        self._repeated.stop()
        self.sign(self._clock.now_ns())
        if self._witness is not None:
            self._witness.close()

    @property
    def missed(self) -> int:
        """How often a head could not be kept elsewhere."""
        return 0 if self._witness is None else self._witness.failures

    def tree_head(self, owner: str) -> tuple[TreeHead, Sequence[bytes]] | None:
        """Return the signed tree head of a chain, and the roots of its chunks.

        None where no head covers it, or nothing is signed any more. Any thread may ask.
        """
        leaf, t_ns = self._signed.get(owner, (None, 0))
        if leaf is None or not leaf.tree or self.refusal:
            return None
        return tree_head(leaf, t_ns, self._signer), self._proven[owner][1].chunks

    def take_unsaid(self) -> dict[str, str]:
        """Return once, by twin, what its people have to be told."""
        unsaid, self._unsaid = self._unsaid, {}
        return unsaid

    def sign(self, now_ns: int) -> Head | None:
        """Sign a head; return None where no chain has grown, or nothing can be proven."""
        if self.refusal:
            return None
        leaves = []
        for owner, end in self._store.ends().items():
            before = self.merkle.leaves.get(owner)
            if before is not None and before.end == end:
                continue
            if not self._extend(owner, end):
                return None
            log = self._proven[owner][1]
            digest, count = self._store.digest(owner)
            link = end.digest.hex()
            leaves.append(MerkleLeaf(owner, end.length, link, count, digest, log.root.hex()))
        if not leaves:
            return None
        self.merkle.take(leaves)
        t_ns = max(now_ns, self.head.t_ns if self.head is not None else now_ns)
        head = headed(self.merkle.root, len(self.merkle.leaves), self.head, t_ns, self._signer)
        body = json.dumps({"head": head._asdict(), "leaves": leaves}, separators=(",", ":"))
        self._store.add_head(HeadRow(head.number, head.t_ns, body))
        self.head = head
        self._signed.update({leaf.asset: (leaf, head.t_ns) for leaf in leaves})
        if self._witness is not None:
            self._witness.take(head)
        for leaf in leaves:
            if ":" not in leaf.asset:  # else a composite, of which no stream tells
                self._tell(head, leaf)
        return head

    def _begin(self) -> None:
        """Compare the whole store with its last head, and let its blocks be sealed."""
        seal = self._signer.seal
        self._store.seal_with(None)
        try:
            kept = self._witness.last if self._witness is not None else None
        except ValueError as error:
            self._refuse(f"the file of heads cannot be read: {error}", {})
            return
        found = audit_store(self._store, public=self._signer.public, kept=kept, seal=seal)
        if found.wrong and found.last is not None and kept in (None, found.last):
            if self._settings.continue_after_head == found.last.number:
                logger.warning(
                    "The ledger continues after head %d without proof of what is there now: %s",
                    found.last.number,
                    "; ".join(found.wrong[:5]),
                )
                self._store.seal_with(seal)
                self._store.renew_basis()
                public = found.last.public
                found = audit_store(self._store, public=public, seal=seal)
        self._refuse_where_wrong(found)
        if not found.wrong:
            self._store.seal_with(seal)
            self.merkle, self.head, self._proven = found.standing, found.last, found.ends
            self._signed = {
                owner: (leaf, found.signed_ns[owner])
                for owner, leaf in found.standing.leaves.items()
            }

    def _extend(self, owner: str, end: Link) -> bool:
        """Compare what was chained since the last signature with what the server chained."""
        link, log = self._proven.get(owner, (beginning(owner), CompactRange()))
        entries = self._store.entries(owner, link.length)
        if linked(link, entries) != end:
            what = f"the entries behind {link.length} are not those that this server chained"
            self._refuse(f"{owner}: {what}", {owner: [what]})
            return False
        log.extend(entry.written for entry in entries)
        self._proven[owner] = end, log
        return True

    def _refuse_where_wrong(self, found: Audit) -> None:
        if found.wrong:
            self._refuse("; ".join(found.wrong[:MOST_NAMED]), found.by_chain)

    def _refuse(self, why: str, by_chain: Mapping[str, Sequence[str]]) -> None:
        """Sign and seal nothing more, and say so; to each site what concerns it only."""
        self._store.seal_with(None)
        self.refusal = f"The ledger is not signed any more: {why}. {_CURE}"
        logger.error("%s", self.refusal)
        for chain in sorted(by_chain)[:MOST_TWINS_TOLD]:
            what = "; ".join(by_chain[chain][:MOST_NAMED])
            self._unsaid[chain] = f"The ledger is not signed any more: {what}. {_CURE}"

    def _tell(self, head: Head, leaf: MerkleLeaf) -> None:
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
            tree=leaf.tree,
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
    """Write entries compactly: consecutive features of a boot as one range, others packed."""
    for is_features, group in itertools.groupby(
        entries, lambda entry: entry.kind == kinds.FEATURES
    ):
        if not is_features:
            written = base64.b64encode(packed(group)).decode()
            yield Accepted(kind="w", entries=written)
            continue
        # Key less place stays among consecutive features.
        for _, several in itertools.groupby(enumerate(group), lambda one: one[1].key - one[0]):
            keys = [entry.key for _, entry in several]
            yield Accepted(
                kind=kinds.FEATURES,
                boot=boots.get(keys[0] >> 40, ""),
                number=keys[0] >> 40,
                first=keys[0] & _LOW,
                last=keys[-1] & _LOW,
            )
