"""Entries and signed heads of the ledger."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from slowtime_schemas.quantities import (
    Frozen,
)

from .base import Message

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class Accepted(Frozen):
    """Entries of an asset's ledger in a row: features of one boot, or anything else."""

    kind: Annotated[
        Literal["f", "w", "r", "a", "v", "e", "d"],
        Field(
            description="f features; w any other entries, in `entries`; up to version 2: r a "
            "registration; a an acknowledgement; v an event of the asset; e estimated anew; "
            "d deleted."
        ),
    ]
    boot: str = ""
    number: Annotated[int, Field(ge=0, description="Of the boot, as the server counts.")] = 0
    first: Annotated[int, Field(ge=0, description="Sequence, of features.")] = 0
    last: Annotated[int, Field(ge=0)] = 0
    key: Annotated[int, Field(ge=0, description="Of anything else.")] = 0
    digest: Sha256 | None = None
    entries: Annotated[
        str,
        Field(
            max_length=1_200_000,  # of 20,000 entries
            description="Of w: entries of 41 bytes each (kind, key, hash), base64.",
        ),
    ] = ""


class Branch(Frozen):
    """What a hash is hashed with next, and on which side that stands."""

    side: Literal["left", "right"]
    hash: Sha256


class SignedHead(Frozen):
    """A signed hash over the ledgers of all assets of a server."""

    number: Annotated[int, Field(ge=1)]
    t_ns: int
    assets: Annotated[int, Field(ge=0, description="Leaves of the tree.")]
    root: Annotated[Sha256, Field(description="Of the Merkle tree over them (RFC 6962).")]
    previous: Annotated[Sha256, Field(description="Of the head before; zeros for the first.")]
    public: Annotated[str, Field(description="Ed25519 public key, base64.")]
    signature: Annotated[str, Field(description="Of number to public, base64.")]


class LedgerUpdate(Message):
    """Rows that the twin server accepted for an asset, with a signed head that covers them."""

    MESSAGE: ClassVar[str] = "ledger"
    VERSION: ClassVar[int] = 3

    version: Literal[3] = 3
    count: Annotated[int, Field(ge=0, description="Entries of the asset's chain.")]
    link: Annotated[Sha256, Field(description="Hash of all of them in their order.")]
    history_count: Annotated[int, Field(ge=0)]
    history: Annotated[Sha256, Field(description="Of so many features with their states.")]
    tree: Annotated[
        Sha256 | None,
        Field(description="Merkle tree hash of the entries (RFC 9162); none up to version 2."),
    ] = None
    accepted_after: Annotated[
        int, Field(ge=0, description="How many entries there were before those of `accepted`.")
    ]
    accepted: tuple[Accepted, ...] = ()
    proof: Annotated[
        tuple[Branch, ...],
        Field(description="What the asset's leaf is hashed with, up to the root of `head`."),
    ] = ()
    head: SignedHead
