"""The assignment of assets to shards."""

import pytest

from slowtime_schemas.partitions import PARTITIONS
from slowtime_services.shards import Share, owners, shard_of


@pytest.mark.parametrize("count", [2, 3, 8, 17])
def test_without_one_shard_only_its_own_partitions_move(count):
    every = range(PARTITIONS)
    before = [shard_of(partition, range(count)) for partition in every]
    for removed in range(count):
        rest = [shard for shard in range(count) if shard != removed]
        after = [shard_of(partition, rest) for partition in every]
        moved = {partition for partition in every if before[partition] != after[partition]}
        assert moved == {partition for partition in every if before[partition] == removed}
        assert removed not in after


@pytest.mark.parametrize("count", [1, 2, 8, 256])
def test_every_asset_belongs_to_exactly_one_shard(count):
    for number in range(100):
        shares = [Share(index, count) for index in range(count)]
        assert sum(share.has(f"asset-{number}") for share in shares) == 1


def test_each_of_eight_shards_has_at_least_half_of_an_equal_share():
    counts = [owners(8).count(shard) for shard in range(8)]
    assert sum(counts) == PARTITIONS
    assert min(counts) >= 16
    assert max(counts) <= 48


def test_the_assignment_never_changes():
    # Histories lie where it says; computed once and kept.
    assert owners(4)[:16] == (2, 0, 1, 0, 1, 3, 3, 3, 0, 3, 1, 0, 3, 2, 1, 0)
    assert Share(3, 4).has("bridge-7")
