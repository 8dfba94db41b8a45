"""Signed tree heads: one hash over the chain of one twin, signed by the server.

A head of a server commits to the ends of all its chains. A tree head commits to one of them, so
that whoever may see one site only can keep and compare it without anything of another's.

References
----------
RFC 9162, "Certificate Transparency Version 2.0" (2021), section 4.10; the signature is Ed25519
over text instead of TLS structures.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from slowtime_services.credentials import Signer, is_signed

from .heads import MerkleLeaf, read_fields


class TreeHead(NamedTuple):
    """A signed hash over the first entries of one chain."""

    chain: str
    """Id of the twin."""
    size: int
    """Number of entries."""
    tree: str
    """Merkle tree hash of them, hexadecimal."""
    t_ns: int
    """When the server compared and signed them [ns since 1970]."""
    public: str
    signature: str

    @property
    def said(self) -> bytes:
        """Bytes that are signed."""
        return "\n".join(map(str, ("slowtime tree head 1", *self[:5]))).encode()

    @property
    def is_signed(self) -> bool:
        """Whether the key that it names has signed it; the key itself is checked elsewhere."""
        return is_signed(self.said, self.signature, self.public)

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Self:
        """Read one from JSON.

        Raises
        ------
        ValueError
            If a part is missing or of another kind.
        """
        return cls(**read_fields("tree head", cls.__annotations__, told))


def tree_head(leaf: MerkleLeaf, t_ns: int, signer: Signer) -> TreeHead:
    """Sign the end of a chain that a head of the server vouches for."""
    unsigned = TreeHead(leaf.asset, leaf.length, leaf.tree, t_ns, signer.public, "")
    return unsigned._replace(signature=signer.sign(unsigned.said))
