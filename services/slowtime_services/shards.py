"""Assignment of assets to shards by rendezvous hashing of their partitions."""

import dataclasses
import functools
import hashlib
from collections.abc import Sequence

from slowtime_schemas.partitions import PARTITIONS, partition_of


def shard_of(partition: int, shards: Sequence[int]) -> int:
    """Return the shard that has a partition: the one with the greatest hash for it.

    A shard's hash does not depend on the other shards. Without one of N shards, its partitions
    go to the others, and every other partition stays where it is.

    Parameters
    ----------
    partition
        0 to 255, as `partition_of` gives it.
    shards
        Numbers of the shards there are; at least one.

    Returns
    -------
    int
        One of `shards`.

    References
    ----------
    D. G. Thaler, C. V. Ravishankar, Using name-based mappings to increase hit rates, IEEE/ACM
    Transactions on Networking 6 (1998) 1-14: highest random weight, or rendezvous, hashing.

    Examples
    --------
    >>> [shard_of(partition, range(4)) for partition in range(8)]
    [2, 0, 1, 0, 1, 3, 3, 3]
    """
    return max(shards, key=lambda shard: _weight(shard, partition))


def _weight(shard: int, partition: int) -> bytes:
    return hashlib.sha256(f"{shard}/{partition}".encode()).digest()


@functools.lru_cache(maxsize=64)
def owners(count: int) -> tuple[int, ...]:
    """Return the shard of each of the 256 partitions, where there are `count` shards."""
    return tuple(shard_of(partition, range(count)) for partition in range(PARTITIONS))


@dataclasses.dataclass(frozen=True, slots=True)
class Share:
    """Assets that shard `index` of `count` has.

    Examples
    --------
    >>> sum(Share(index, 3).has("bridge-7") for index in range(3))
    1
    """

    index: int
    count: int

    def has(self, asset: str) -> bool:
        """Whether an asset belongs to this shard."""
        return owners(self.count)[partition_of(asset)] == self.index

    def __str__(self) -> str:
        """Name the share, as `2of8`."""
        return f"{self.index}of{self.count}"
