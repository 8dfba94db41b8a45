"""The Zenoh router that edges, twin and recorder connect to."""

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from slowtime_schemas.messages import LinkProfile
from slowtime_services.bus import BusUnreachableError, ZenohBus
from slowtime_services.credentials import Credentials, CredentialsError
from slowtime_services.credentials.credential_folder import (
    check_encrypted,
    reachable_from_elsewhere,
)
from slowtime_services.link_profiles import LEASES
from slowtime_services.shutdown import ended_by_signals

logger = logging.getLogger(__name__)

DEFAULT_LISTEN = ("tcp/127.0.0.1:7447",)


def run(
    listen: Sequence[str] = DEFAULT_LISTEN,
    connect: Sequence[str] = (),
    *,
    stop: threading.Event | None = None,
    credentials: Path | None = None,
    insecure: bool = False,
    options: Mapping[str, object] | None = None,
    ready: Callable[[Sequence[str]], None] | None = None,
    link: LinkProfile = "lab",
) -> None:
    """Route until `stop` is set, or until SIGINT or SIGTERM.

    Parameters
    ----------
    listen
        Endpoints to listen on.
    connect
        Other routers to join.
    stop
        Set from outside to end.
    credentials
        Folder that `slowtime keys` made for the router: who may connect, and do what.
    insecure
        Whether to listen to other machines without.
    options
        Further Zenoh settings.
    ready
        Told the endpoints once they listen.
    link
        Profile of the edge agents, which decides on keep-alives.

    Raises
    ------
    BusUnreachableError
        If an endpoint is taken or misspelt.
    CredentialsError
        If the credentials are of no use, or are needed and not there.
    """
    own = _secured(listen, connect, credentials, insecure) | dict(options or {})
    lease_s, keep_alives = LEASES[link]
    bus = ZenohBus(
        "router", connect, listen, lease_s=lease_s, keep_alives=keep_alives, options=own
    )
    with ended_by_signals(stop) as end, bus:
        logger.info("Router listens on %s.", ", ".join(listen))
        if ready is not None:
            ready(listen)
        end.wait()
    logger.info("Router has ended.")


def _secured(
    listen: Sequence[str], connect: Sequence[str], credentials: Path | None, insecure: bool
) -> dict[str, object]:
    if credentials is not None:
        check_encrypted([*listen, *connect])
        return Credentials.read(credentials).router_options()
    if (open_to_all := reachable_from_elsewhere(listen)) and not insecure:
        raise CredentialsError(
            f"At {', '.join(open_to_all)} anybody who can reach this computer could read "
            "and write everything. Create certificates with `slowtime keys` and give "
            "--credentials keys/router, or listen at tcp/127.0.0.1:7447 only, or accept "
            "the risk with --insecure."
        )
    return {}


def check(endpoint: str, *, timeout_s: float = 2.0) -> bool:
    """Whether a router answers at `endpoint`: a session opens and sees one.

    Made for a container's health check; it takes at most about `timeout_s`.
    """
    try:
        with ZenohBus("client", connect=[endpoint], open_timeout_s=timeout_s) as bus:
            return bus.connected
    except BusUnreachableError:
        return False
