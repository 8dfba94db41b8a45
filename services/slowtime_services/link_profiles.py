"""Profiles of the link between edge agents and their router: intervals, leases and bytes.

Both ends of a link send keep-alives, each by its own lease, so that agent and router are given
the same profile.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from slowtime_schemas.messages import LinkProfile

KEEP_ALIVE_BYTES = 300
"""Bytes of a keep-alive and its TCP acknowledgement, in both directions together [bytes].
Measured: 240 with TLS."""

MESSAGE_BYTES = 330
"""Bytes on the link of a message beside its payload [bytes]: key, encoding and attachment of
Zenoh, one record of TLS, headers of TCP and IPv4, and the TCP acknowledgement."""

CONNECTION_BYTES = 9_000
"""Bytes of a new connection: handshake of TLS with certificates of both sides, session and
declarations of Zenoh, in both directions [bytes]. Measured: 8,200."""


class Lease(NamedTuple):
    """When a silent process counts as offline, and how often one says that it is not."""

    lease_s: float
    keep_alives: int


LEASES: Mapping[LinkProfile, Lease] = MappingProxyType(
    {"lab": Lease(5.0, 4), "field": Lease(30.0, 3), "metered": Lease(120.0, 3)}
)

INTERVALS: Mapping[LinkProfile, Mapping[str, float]] = MappingProxyType(
    {
        "lab": {},
        "field": {"health_every_s": 300.0, "about_every_s": 3_600.0, "features_every_s": 120.0},
        "metered": {
            "health_every_s": 900.0, "about_every_s": 86_400.0, "features_every_s": 900.0,
        },
    }
)  # fmt: skip
"""Settings of an agent's messages that differ from those of a laboratory."""
