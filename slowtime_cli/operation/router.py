"""The verbs `router` and `status`: runs a Zenoh router, and checks that it answers."""

import logging
import threading
from pathlib import Path
from typing import Literal

import click

from slowtime_cli.shared.options import endpoints
from slowtime_schemas.streams import address_of, alive_key
from slowtime_services import router as router_process
from slowtime_services.bus import Bus, BusUnreachableError, TwoVersionBus, ZenohBus
from slowtime_services.credentials import options_for


def router(
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    credentials: Path | None,
    link: Literal["lab", "field", "metered"],
    insecure: bool,
) -> None:
    """Run a Zenoh router that edges, twin server and recorder connect to."""
    router_process.run(
        endpoints(listen, credentials),
        connect,
        credentials=credentials,
        insecure=insecure,
        link=link,
        ready=lambda where: click.echo(f"Router on {', '.join(where)}"),
    )


def status(
    connect: tuple[str, ...], credentials: Path | None, asset: str | None, timeout_s: float
) -> int:
    """Show whether the router answers, and which edges are online."""
    logging.getLogger("slowtime_services").setLevel(logging.CRITICAL)
    site, _, name = (asset or "*.*").partition(".")
    connect = endpoints(connect, credentials)
    options = options_for(credentials, connect)
    try:
        with ZenohBus("client", connect, open_timeout_s=timeout_s, options=options) as bus:
            alive = _alive(
                TwoVersionBus(bus), alive_key(site, name), timeout_s if asset else 0.5
            )
    except BusUnreachableError as error:
        click.echo(str(error), err=True)
        return 1
    for key in sorted(alive):
        click.echo("{}.{} is alive".format(*(address_of(key) or ("?", key))))
    if not alive:
        click.echo(
            f"{asset or 'No edge agent'} is {'not ' if asset else ''}alive; the router answers."
        )
    return 0 if alive or asset is None else 1


def _alive(bus: Bus, key: str, timeout_s: float) -> set[str]:
    """Return keys of present processes: the first one, or all within `timeout_s`."""
    seen: set[str] = set()
    heard = threading.Event()

    def change(who: str, alive: bool) -> None:
        (seen.add if alive else seen.discard)(who)
        if who == key:
            heard.set()

    watching = bus.watch(key, change)
    heard.wait(timeout_s)
    watching.close()
    return seen
