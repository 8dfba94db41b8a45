"""The verb `keys`: a small certificate authority for the bus of one site."""

import datetime
from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.table import Table

from slowtime_services.credentials import ROLES, Authority, Issued

from .options import Name, PlainText, together
from .terminal import ERR, plural

HOSTS = ("localhost", "127.0.0.1")

out_option = click.option(
    "--out",
    "home",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("keys"),
    show_default=True,
    help="Folder of the authority and of all it makes.",
)
days_option = click.option(
    "--days",
    type=click.IntRange(1, 3650),
    default=365,
    show_default=True,
    help="How long a certificate is valid.",
)


@click.group(
    epilog="""\b
Examples:
  slowtime keys make lab --asset beam --asset frame --host 10.0.0.2
  slowtime router --credentials keys/router --listen tls/0.0.0.0:7447
  slowtime twin --credentials keys/server --connect tls/10.0.0.2:7447
  slowtime edge --credentials keys/edge-beam --connect tls/10.0.0.2:7447 --config edge.toml

Each process gets its own folder and no other; keys/authority stays where nobody else is. A
router reads who may do what when it starts: copy keys/router again and restart it after each
change. Edges keep their features meanwhile.
"""
)
def keys() -> None:
    """Make, renew and withdraw certificates of a site's bus."""


@keys.command()
@click.argument("site", type=Name())
@click.option("--asset", "assets", multiple=True, type=Name(), help="An edge agent to be.")
@click.option(
    "--host",
    "hosts",
    multiple=True,
    type=PlainText(),
    help="Name or address at which others reach the router; localhost always.",
)
@days_option
@out_option
def make(
    site: str, assets: tuple[str, ...], hosts: tuple[str, ...], days: int, home: Path
) -> None:
    """Make what is missing: authority, router, server, observer, player, and each edge."""
    authority = Authority.open(home, site)
    lasts = datetime.timedelta(days=days)
    at = tuple(dict.fromkeys((*HOSTS, *hosts)))
    old = next((i for i in reversed(authority.valid) if i.role == "router"), None)
    wanted: list[tuple[str, str | None]] = [(role, None) for role in ROLES if role != "edge"]
    wanted += [("edge", asset) for asset in assets]
    for role, asset in wanted:
        moved = role == "router" and old is not None and not set(hosts) <= set(old.hosts)
        if authority.has(role, asset) and not moved:
            continue
        named = tuple(dict.fromkeys((*(old.hosts if old else ()), *at)))
        hosts_of = named if role in ("router", "server") else ()
        click.echo(authority.issue(role, asset, hosts=hosts_of, lasts=lasts))
    ERR.print(
        f"{plural(len(authority.valid), 'valid certificate')} of {site}. Restart the router, "
        "so that it knows them."
    )


@keys.command()
@click.option(
    "--within-days",
    type=click.IntRange(0, 3650),
    default=30,
    show_default=True,
    help="Renew what expires within so many days.",
)
@days_option
@out_option
def renew(within_days: int, days: int, home: Path) -> None:
    """Issue anew what is about to expire; the old one is good until it does."""
    authority = Authority.open(home)
    made = authority.renew(datetime.timedelta(days=within_days), datetime.timedelta(days=days))
    for issued in made:
        click.echo(home / issued.folder)
    ERR.print(f"{plural(len(made), 'certificate')} renewed.")


@keys.command()
@click.option("--asset", type=Name(), help="The edge agent of this asset.")
@click.option(
    "--role",
    type=click.Choice([role for role in ROLES if role not in ("edge", "router")]),
    help="Whoever has this role.",
)
@out_option
def withdraw(asset: str | None, role: str | None, home: Path) -> None:
    """Refuse, from the router's next start, all that was issued to an edge or a role."""
    together([("--asset", asset), ("--role", role)])
    if asset is None and role is None:
        raise click.UsageError("Whose? Give --asset or --role.")
    count = Authority.open(home).withdraw(role or "edge", asset)
    if not count:
        raise click.UsageError(f"Nothing valid was issued to {asset or role}.")
    ERR.print(f"{plural(count, 'certificate')} withdrawn. Restart the router with keys/router.")


@keys.command(name="list")
@out_option
def list_(home: Path) -> None:
    """Show what was issued, and until when it is valid."""
    now = datetime.datetime.now(datetime.UTC)
    table = Table(box=SIMPLE_HEAD)
    for heading in ("folder", "name", "expires", ""):
        table.add_column(heading)
    for issued in Authority.open(home).issued:
        expires = datetime.datetime.fromisoformat(issued.expires)
        table.add_row(
            issued.folder, issued.name, f"{expires:%Y-%m-%d %H:%M}Z", _standing(issued, now)
        )
    from rich.console import Console

    Console().print(table)


def _standing(issued: Issued, now: datetime.datetime) -> str:
    if issued.withdrawn:
        return "withdrawn"
    left = issued.left(now)
    if left.total_seconds() <= 0:
        return "expired"
    return "good" if left.days >= 30 else f"{left.days} days left"
