"""Notices to systemd: ready, alive, stopping, status, as `sd_notify` sends them.

References
----------
sd_notify(3), sd_watchdog_enabled(3) of systemd: one datagram of ``NAME=value`` lines to the
socket that the variable NOTIFY_SOCKET names.
"""

import contextlib
import os
import socket


def notify(*lines: str) -> bool:
    """Send some lines to systemd; False where no systemd listens.

    Parameters
    ----------
    lines
        Such as ``READY=1`` or ``STATUS=...``.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address or not hasattr(socket, "AF_UNIX"):
        return False
    if address.startswith("@"):  # in the abstract namespace of Linux
        address = "\0" + address[1:]
    text = "\n".join(line.replace("\n", " ") for line in lines)
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
        # A full queue of systemd must not hold up who only says that it is alive.
        out.setblocking(False)
        out.sendto(text.encode(), address)
        return True
    return False


def watchdog_s() -> float | None:
    """Return how long systemd waits for a sign of life [s]; None where it does not."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    whose = os.environ.get("WATCHDOG_PID", "")
    if not microseconds.isascii() or not microseconds.isdigit() or int(microseconds) == 0:
        return None
    if whose and whose != str(os.getpid()):
        return None
    return int(microseconds) / 1e6
