"""Merkle trees and proofs are those of RFC 9162, and agree with its recursive definition."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime_services.ledger import (
    CompactRange,
    consistency_proof,
    inclusion_proof,
    is_consistent,
    root_of_inclusion,
    roots_over,
)
from slowtime_services.ledger.consistency import CHUNK

LEAVES = [
    bytes.fromhex(text)
    for text in (
        "", "00", "10", "2021", "3031", "40414243", "5051525354555657",
        "606162636465666768696a6b6c6d6e6f",
    )
]  # fmt: skip
"""Of the reference implementation of Certificate Transparency, as the roots and proofs."""
ROOTS = (
    "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
    "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
    "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
    "d37ee418976dd95753c1c73862b9398fa2a2cf9b4ff0fdfe8b30cd95209614b7",
    "4e3bbb1f7b478dcfe71fb631631519a3bca12c9aefca1612bfce4c13a86264d4",
    "76e67dadbcdf1e10e1b74ddc608abd2f98dfb16fbce75277b5232a127f2087ef",
    "ddb89be403809e325750d3d263cd78929c2942b7942a34b77e122c9594a74c8c",
    "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
)
PROOFS = {
    (1, 1): (),
    (1, 8): (
        "96a296d224f285c67bee93c30f8a309157f0daa35dc5b87e410b78630a09cfc7",
        "5f083f0a1a33ca076a95279832580db3e0ef4584bdff1f54c8a360f50de3031e",
        "6b47aaf29ee3c2af9af889bc1fb9254dabd31177f16232dd6aab035ca39bf6e4",
    ),
    (6, 8): (
        "0ebc5d3437fbe2db158b9f126a1d118e308181031d0a949f8dededebc558ef6a",
        "ca854ea128ed050b41b35ffc1b87b8eb2bde461e9e3b5596ece6b9d5975a0ae0",
        "d37ee418976dd95753c1c73862b9398fa2a2cf9b4ff0fdfe8b30cd95209614b7",
    ),
    (2, 5): (
        "5f083f0a1a33ca076a95279832580db3e0ef4584bdff1f54c8a360f50de3031e",
        "bc1a0643b12e4d2d7c77918f44e0f4f79a838b6cf9ec5b5c283e1f4d88599e6b",
    ),
}


def defined(leaves):
    """Merkle tree hash by the words of section 2.1.1."""
    if not leaves:
        return hashlib.sha256().digest()
    if len(leaves) == 1:
        return hashlib.sha256(b"\x00" + leaves[0]).digest()
    k = 1
    while 2 * k < len(leaves):
        k *= 2
    return hashlib.sha256(b"\x01" + defined(leaves[:k]) + defined(leaves[k:])).digest()


def of(leaves):
    """Roots of ranges of some leaves."""
    return roots_over([], lambda begin, end: leaves[begin:end])


def root_of(leaves):
    log = CompactRange()
    log.extend(leaves)
    return log.root


@pytest.mark.parametrize("size", range(1, 9))
def test_roots_are_those_of_the_reference_implementation(size):
    assert root_of(LEAVES[:size]).hex() == ROOTS[size - 1]


@pytest.mark.parametrize("sizes", PROOFS)
def test_proofs_are_those_of_the_reference_implementation(sizes):
    first, second = sizes
    proof = consistency_proof(first, second, of(LEAVES))
    assert [node.hex() for node in proof] == list(PROOFS[sizes])


LOGS = st.lists(st.binary(max_size=3), min_size=1, max_size=40)


@given(leaves=LOGS, data=st.data())
def test_a_log_that_grew_is_proven_and_another_is_not(leaves, data):
    first = data.draw(st.integers(0, len(leaves)))
    one, both = root_of(leaves[:first]), root_of(leaves)
    proof = consistency_proof(first, len(leaves), of(leaves))
    assert both == defined(leaves)
    assert is_consistent(first, len(leaves), one, both, proof)
    if first:
        at = data.draw(st.integers(0, first - 1))
        forged = [*leaves[:at], leaves[at] + b"x", *leaves[at + 1 :]]
        again = consistency_proof(first, len(forged), of(forged))
        assert not is_consistent(first, len(forged), one, root_of(forged), again)
    assert not is_consistent(first, len(leaves), one, both, [*proof, one])


@given(leaves=LOGS, data=st.data())
def test_a_leaf_is_proven_at_its_place_only(leaves, data):
    index = data.draw(st.integers(0, len(leaves) - 1))
    proof = inclusion_proof(index, len(leaves), of(leaves))
    root = defined(leaves)
    assert root_of_inclusion(index, len(leaves), leaves[index], proof) == root
    assert root_of_inclusion(index, len(leaves), leaves[index] + b"x", proof) != root
    assert root_of_inclusion(len(leaves), len(leaves), leaves[index], proof) is None


def test_what_is_out_of_range_is_refused_with_what_to_give():
    with pytest.raises(ValueError, match="from 0 to 8"):
        consistency_proof(9, 8, of(LEAVES))
    with pytest.raises(ValueError, match="from 0 to 7"):
        inclusion_proof(8, 8, of(LEAVES))


SIZES = (CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK, 3 * CHUNK + 5)


@pytest.mark.parametrize("size", SIZES)
def test_a_proof_of_a_long_log_reads_leaves_of_two_chunks_at_most(size):
    leaves = [b"%d" % n for n in range(size)]
    log, read = CompactRange(), []
    log.extend(leaves[:10])
    log = log.copy()
    log.extend(leaves[10:])
    assert log.chunks == [
        root_of(leaves[at : at + CHUNK]) for at in range(0, size - CHUNK + 1, CHUNK)
    ]

    def some(begin, end):
        read.append(end - begin)
        return leaves[begin:end]

    for first in (1, 10, size // 2, size - 1):
        read.clear()
        proof = consistency_proof(first, size, roots_over(log.chunks, some))
        assert is_consistent(first, size, root_of(leaves[:first]), log.root, proof)
        assert sum(read) <= 2 * CHUNK
        read.clear()
        proof = inclusion_proof(first, size, roots_over(log.chunks, some))
        assert root_of_inclusion(first, size, leaves[first], proof) == log.root
        assert sum(read) <= 2 * CHUNK
