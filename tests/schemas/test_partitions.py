import collections

from slowtime_schemas.partitions import PARTITIONS, partition_of


def test_partitions_are_even_within_sampling() -> None:
    counts = collections.Counter(partition_of(f"asset-{number}") for number in range(50_000))
    expected = 50_000 / PARTITIONS
    chi_squared = sum((counts[p] - expected) ** 2 / expected for p in range(PARTITIONS))
    # 255 degrees of freedom: mean 255, standard deviation 22.6.
    assert 255 - 4 * 22.6 < chi_squared < 255 + 4 * 22.6


def test_the_partition_of_an_asset_never_changes() -> None:
    # By `sha256sum`; keys that edges of older versions send carry these numbers.
    assert [partition_of(name) for name in ("beam", "bridge-7", "Brücke")] == [0xAE, 0x59, 0xA6]
