"""Addresses that a name in the settings may not lead to, and the look-up of names.

Who runs the name server of a receiver can let its name lead anywhere: to the machine of the
twin server, whose other services trust it, or to the metadata service of a cloud, which hands
out credentials. So a name is looked up once, its addresses are checked, and the connection goes
to one of them, not to the name. What an operator has written as an address, or as localhost, is
meant as it stands.
"""

import ipaddress
import socket
from typing import Any, TypeAlias

Address: TypeAlias = ipaddress.IPv4Address | ipaddress.IPv6Address
Found: TypeAlias = tuple[int, Any]
"""Family of a socket and the address to connect it to, as `socket.getaddrinfo` returns them."""

METADATA = tuple(
    ipaddress.ip_address(text)
    for text in (
        "fd00:ec2::254",  # Amazon EC2, IMDS over IPv6
        "fd00:ec2::23",  # Amazon EKS, pod identity
        "fd20:ce::254",  # Google Cloud over IPv6
        "100.100.100.200",  # Alibaba Cloud
        "192.0.0.192",  # Oracle Cloud
        "168.63.129.16",  # Azure, wire server
    )
)
"""Metadata services of clouds outside of the link-local range 169.254.0.0/16, as their
documentation states them."""

_NAT64 = ipaddress.ip_network("64:ff9b::/96")
"""IPv4 addresses behind a translator (RFC 6052)."""
_COMPATIBLE = ipaddress.ip_network("::/96")
"""IPv4-compatible addresses (RFC 4291, deprecated)."""


class LocalAddressError(OSError):
    """A name that leads to this machine, to its link, or to a metadata service."""


def is_local(address: Address) -> bool:
    """Whether an address is of this machine or its link, unspecified, or a metadata service.

    Examples
    --------
    >>> [is_local(ipaddress.ip_address(a)) for a in ("::ffff:127.0.0.1", "169.254.169.254")]
    [True, True]
    >>> [is_local(ipaddress.ip_address(a)) for a in ("10.1.2.3", "2001:db8::1")]
    [False, False]
    """
    inner = address if isinstance(address, ipaddress.IPv4Address) else _within(address)
    if inner is not None and inner != address:
        return is_local(inner)
    return bool(
        address.is_loopback
        or address.is_link_local
        or address.is_unspecified
        or address.is_multicast
        or (isinstance(address, ipaddress.IPv4Address) and address.packed[0] == 0)
        or address in METADATA
    )


def _within(address: ipaddress.IPv6Address) -> ipaddress.IPv4Address | None:
    """IPv4 address that an IPv6 address stands for."""
    if address.ipv4_mapped is not None:
        return address.ipv4_mapped
    if address.sixtofour is not None:
        return address.sixtofour
    if address in _NAT64 or (address in _COMPATIBLE and int(address) > 1):
        return ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
    return None


def is_written_out(host: str) -> bool:
    """Whether a host is an address or localhost, and so no name that others could turn."""
    if host.casefold().rstrip(".") == "localhost":
        return True
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return False
    return True


def look_up(host: str, port: int, *, local: bool = False) -> list[Found]:
    """Look a name up, once, and check where it leads.

    Parameters
    ----------
    host, port
        Of the settings.
    local
        Whether the settings allow addresses of this machine and its link.

    Returns
    -------
    Families and addresses to connect to, in the order in which to try them.

    Raises
    ------
    LocalAddressError
        Where one of the addresses is of this machine or its link, and that is not allowed.
        OSError where the name is not known.
    """
    told = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    found = [(int(family), place) for family, _, _, _, place in told]
    if local or is_written_out(host):
        return found
    for _, place in found:
        address = ipaddress.ip_address(str(place[0]).partition("%")[0])
        if is_local(address):
            raise LocalAddressError(
                f"{host} leads to {address}, which is this machine, its link or a metadata "
                "service. Write the address itself in the settings, or set local = true, if "
                "that is meant"
            )
    return found
