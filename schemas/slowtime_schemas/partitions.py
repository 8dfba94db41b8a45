"""The partition of an asset, by which keys and servers divide the assets of a site."""

import hashlib

PARTITIONS = 256
"""Number of partitions of a site [1]; fixed, because keys carry it.

256 divide 100,000 assets into some 400 each, and leave each of 64 servers four to share out.
"""


def partition_of(asset: str) -> int:
    """Return the partition of an asset, the same on every machine and in every version.

    Parameters
    ----------
    asset
        Identifier of the asset, as in keys.

    Returns
    -------
    int
        0 to 255: the first byte of the SHA-256 of the identifier in UTF-8.

    Examples
    --------
    >>> partition_of("bridge-7")
    89
    """
    return hashlib.sha256(asset.encode()).digest()[0]
