"""Arguments and help of the verb `keys`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import Name, PlainText, together

WITHDRAWN = ("server", "observer", "player")
"""Roles that are withdrawn by name: all but routers, and edges, which `--asset` names."""
out_option = click.option(
    "--out",
    "home",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("keys"),
    show_default=True,
    help="Folder of the authority and its certificates.",
)
days_option = click.option(
    "--days",
    type=click.IntRange(1, 3650),
    default=365,
    show_default=True,
    help="How long a certificate is valid.",
)


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime keys make lab --asset beam --asset frame --host 10.0.0.2
  slowtime router --credentials keys/router --listen tls/0.0.0.0:7447
  slowtime twin --credentials keys/server --connect tls/10.0.0.2:7447
  slowtime edge --credentials keys/edge-beam --connect tls/10.0.0.2:7447 --config edge.toml

Copy to each process its own folder and no other; keep keys/authority where nobody else has
access. A router reads access rights when it starts: copy keys/router again and restart it
after each change. Edges keep their features meanwhile.
""",
)
def keys() -> None:
    """Create, renew and revoke the TLS certificates of a site.

    With them the computers of the site authenticate to each other on its message bus.
    """


@keys.command(cls=Deferred, work="operation.keys:make", extra="twin")
@click.argument("site", type=Name())
@click.option("--asset", "assets", multiple=True, type=Name(), help="Asset of an edge agent.")
@click.option(
    "--host",
    "hosts",
    multiple=True,
    type=PlainText(),
    help="Name or address at which others reach the router, in addition to localhost.",
)
@days_option
@out_option
def make(**_given: object) -> None:
    """Create missing credentials: authority, router, server, observer, player, each edge."""


@keys.command(cls=Deferred, work="operation.keys:renew", extra="twin")
@click.option(
    "--within-days",
    type=click.IntRange(0, 3650),
    default=30,
    show_default=True,
    help="Renew certificates that expire within this many days.",
)
@days_option
@out_option
def renew(**_given: object) -> None:
    """Issue expiring certificates again; the old ones are valid until they expire."""


@keys.command(cls=Deferred, work="operation.keys:withdraw", extra="twin")
@click.option("--asset", type=Name(), help="Certificates of this asset's edge agent.")
@click.option(
    "--role",
    type=click.Choice(WITHDRAWN),
    help="All certificates of this role.",
)
@out_option
def withdraw(asset: str | None, role: str | None, **_given: object) -> None:
    """Revoke all certificates of an edge agent or a role, from the router's next start."""
    together([("--asset", asset), ("--role", role)])
    if asset is None and role is None:
        raise click.UsageError("Give --asset or --role to name the certificates to revoke.")


@keys.command(cls=Deferred, work="operation.keys:list_", extra="twin", name="list")
@out_option
def list_(**_given: object) -> None:
    """Show the certificates issued, with their dates of expiry."""
