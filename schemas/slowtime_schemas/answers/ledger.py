"""Answers about the ledger: heads and proofs."""

from pydantic import ConfigDict, Field

from .base import RestAnswer


class HeadModel(RestAnswer):
    """A signed hash over everything that the server had accepted of all its twins."""

    number: int
    t_ns: int
    assets: int
    root: str
    previous: str
    public: str
    signature: str


class HeadList(RestAnswer):
    """Heads in their order; none where the server has no key to sign with."""

    heads: tuple[HeadModel, ...]
    refusal: str = Field(
        "", description="Why nothing is signed any more; empty while all is well."
    )

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "heads": [
                        {
                            "number": 7,
                            "t_ns": 1795233600123456789,
                            "assets": 2,
                            "root": "9f" * 32,
                            "previous": "5c" * 32,
                            "public": "phkz1zZnFSklHpcC5loUFGLlUp9TMlBk/UDa2AeoaYg=",
                            "signature": "bm" * 43 + "==",
                        }
                    ]
                }
            ]
        }
    )


class TreeHeadModel(RestAnswer):
    """A signed hash over the chain of one twin: the signed tree head of RFC 9162."""

    chain: str = Field(description="Id of the twin.", examples=["lab.beam"])
    size: int = Field(description="Number of entries.")
    tree: str = Field(description="Merkle tree hash of the entries, hexadecimal.")
    t_ns: int = Field(description="When the server compared and signed them [ns since 1970].")
    public: str
    signature: str


class ConsistencyProof(RestAnswer):
    """That a chain begins with its first entries (RFC 9162, section 2.1.4)."""

    head: TreeHeadModel
    first: int
    proof: tuple[str, ...] = Field(description="Hashes, hexadecimal.")


class ProvenReadingModel(RestAnswer):
    """What is hashed of a reading."""

    boot: str
    number: int = Field(description="Number of the boot, above the sequence in its key.")
    sequence: int
    t_ns: int
    slow_time: float
    message: str = Field(description="The features message as it came, in base64.")


class InclusionProof(RestAnswer):
    """That a reading is among the entries of a chain (RFC 9162, section 2.1.3)."""

    head: TreeHeadModel
    index: int = Field(description="Its entry, counted from 0.")
    proof: tuple[str, ...] = Field(description="Hashes, hexadecimal.")
    reading: ProvenReadingModel
