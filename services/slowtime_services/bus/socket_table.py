"""Table of the open TCP connections of this machine, as the kernel keeps it."""

from pathlib import Path

TABLES = (Path("/proc/self/net/tcp"), Path("/proc/self/net/tcp6"))
"""Of IPv4 and IPv6, in the format of proc_pid_net(5)."""
ESTABLISHED = "01"
"""State of a connection that both ends hold (1), in hexadecimal. Source: net/tcp_states.h of
the Linux kernel."""
OVER_TCP = ("tcp", "tls", "ws")
"""Protocols of endpoints that are carried by TCP."""


def established_ports(tables: tuple[Path, ...] = TABLES) -> set[tuple[int, int]] | None:
    """Return local and remote port of each established connection.

    Parameters
    ----------
    tables
        Files of the kernel; those that do not exist are left out.

    Returns
    -------
    The pairs of ports; None where the system has no such file (macOS, Windows).
    """
    found: set[tuple[int, int]] | None = None
    for table in tables:
        try:
            lines = table.read_text().splitlines()[1:]
        except OSError:
            continue
        rows = (line.split() for line in lines)
        found = (found or set()) | {
            (_port(row[1]), _port(row[2])) for row in rows if row[3] == ESTABLISHED
        }
    return found


def ports_of(source: str, destination: str) -> tuple[int, int] | None:
    """Return local and remote port of a link.

    Parameters
    ----------
    source, destination
        Endpoints such as ``"tcp/127.0.0.1:7447"`` or ``"tls/[::1]:7447"``.

    Returns
    -------
    The ports; None where the link is not carried by TCP, or an endpoint has no port.
    """
    if source.partition("/")[0] not in OVER_TCP:
        return None
    ports = [end.partition("?")[0].rpartition(":")[2] for end in (source, destination)]
    if not all(port.isdigit() for port in ports):
        return None
    return int(ports[0]), int(ports[1])


def _port(address: str) -> int:
    return int(address.rpartition(":")[2], 16)
