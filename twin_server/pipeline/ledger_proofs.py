"""Tree heads of chains, and proofs of them, for who keeps a head elsewhere."""

import base64
import itertools
from collections.abc import Iterator
from typing import Any

from slowtime_services.ledger import (
    TreeHead,
    consistency_proof,
    inclusion_proof,
    roots_over,
)
from slowtime_services.ledger.chain import FEATURES
from slowtime_services.ledger.consistency import CHUNK, RootOf
from twin_server.persist import FeatureRow, Store
from twin_server.serve import ProblemError

from .ingestion.pipeline import Pipeline

SHIFT = 40
"""Bits of the sequence in the key of a reading."""

MOST_SEARCHED = 1 << 20
"""Entries that one request looks through for a reading; a second of work."""


class LedgerProofs:
    """Answers what RFC 9162 calls get-sth, get-sth-consistency and get-proof-by-hash."""

    def __init__(self, pipeline: Pipeline, store: Store) -> None:
        self._pipeline, self._store = pipeline, store

    def head(self, twin_id: str) -> dict[str, Any]:
        """Return the signed tree head of a twin's chain."""
        return self._signed(twin_id)[0]._asdict()

    def consistency(self, twin_id: str, first: int) -> dict[str, Any]:
        """Prove that a chain begins with its first entries as they were.

        Raises
        ------
        ProblemError
            If it has fewer.
        """
        head, root_of = self._signed(twin_id)
        if first > head.size:
            raise ProblemError(
                409,
                "chain-is-shorter",
                f"first={first} was given, and the signed chain of {twin_id} has {head.size} "
                "entries. If a head of that many was kept, entries have been removed since: "
                "keep the database as evidence.",
            )
        proof = consistency_proof(first, head.size, root_of)
        return {"head": head._asdict(), "first": first, "proof": [one.hex() for one in proof]}

    def inclusion(
        self, twin_id: str, boot: str, sequence: int, before: int | None
    ) -> dict[str, Any]:
        """Prove that a reading is among the entries of a chain.

        Parameters
        ----------
        before
            Look among the entries before this one; None for the newest.

        Raises
        ------
        ProblemError
            If it is not found.
        """
        head, root_of = self._signed(twin_id)
        number = self._store.boot_number(twin_id, boot)
        rows = (
            [] if number is None else self._store.messages_of_boot(number, sequence, sequence)
        )
        if number is None or not rows:
            raise ProblemError(
                404,
                "no-such-reading",
                f"{twin_id} has no reading {sequence} of boot {boot}. Its history names boots "
                "and sequences.",
            )
        end = head.size if before is None else min(before, head.size)
        index = self._found(twin_id, number << SHIFT | sequence, end)
        proof = inclusion_proof(index, head.size, root_of)
        return {
            "head": head._asdict(),
            "index": index,
            "proof": [one.hex() for one in proof],
            "reading": _reading(boot, rows[0]),
        }

    def _signed(self, twin_id: str) -> tuple[TreeHead, RootOf]:
        signer = self._pipeline.ledger_signer
        if signer is None:
            raise ProblemError(
                404,
                "no-ledger-key",
                "This server signs nothing, since it has no key. Create one with `slowtime db "
                "ledger key`, and start the server with --ledger-key.",
            )
        if signer.refusal:
            raise ProblemError(
                409,
                "ledger-refused",
                "The server cannot prove its database, and signs nothing any more. Verify the "
                "heads that you kept with `slowtime db ledger verify` and a copy of the "
                "database.",
            )
        found = signer.tree_head(twin_id)
        if found is None:
            raise ProblemError(
                404,
                "not-signed-yet",
                f"No head covers {twin_id} yet. Ask again after the next one "
                "(`ledger.every_s`).",
            )
        head, chunks = found

        def leaves(begin: int, end: int) -> list[bytes]:
            return self._store.entries_between(twin_id, begin, end)

        return head, roots_over(chunks, leaves)

    def _found(self, twin_id: str, key: int, end: int) -> int:
        wanted = FEATURES.encode() + key.to_bytes(8, "big")
        for begin, entries in itertools.islice(
            self._backwards(twin_id, end), MOST_SEARCHED // CHUNK
        ):
            for place, entry in enumerate(entries):
                if entry.startswith(wanted):
                    return begin + place
        past = max(0, end - MOST_SEARCHED)
        more = f" Ask on with before={past}." if past else ""
        raise ProblemError(
            404,
            "not-signed-yet",
            f"The reading is not among the entries {past} to {end} that are signed.{more}",
        )

    def _backwards(self, twin_id: str, end: int) -> Iterator[tuple[int, list[bytes]]]:
        while end > 0:
            begin = max(0, end - CHUNK)
            yield begin, self._store.entries_between(twin_id, begin, end)
            end = begin


def _reading(boot: str, row: FeatureRow) -> dict[str, Any]:
    return {
        "boot": boot,
        "number": row.number,
        "sequence": row.sequence,
        "t_ns": row.t_ns,
        "slow_time": row.slow_time,
        "message": base64.b64encode(row.message).decode(),
    }
