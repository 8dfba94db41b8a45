"""The verb `keys`: makes, renews and withdraws the certificates of a site."""

import datetime
from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.table import Table

from slowtime_cli.shared.terminal import ERR, plural
from slowtime_services.credentials import ROLES, Authority, Issued

HOSTS = ("localhost", "127.0.0.1")


def make(
    site: str, assets: tuple[str, ...], hosts: tuple[str, ...], days: int, home: Path
) -> None:
    """Make missing credentials: authority, router, server, observer, player, and each edge."""
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


def renew(within_days: int, days: int, home: Path) -> None:
    """Issue expiring certificates again; the old ones are valid until they expire."""
    authority = Authority.open(home)
    made = authority.renew(datetime.timedelta(days=within_days), datetime.timedelta(days=days))
    for issued in made:
        click.echo(home / issued.folder)
    ERR.print(f"{plural(len(made), 'certificate')} renewed.")


def withdraw(asset: str | None, role: str | None, home: Path) -> None:
    """Withdraw all certificates of an edge or a role, from the router's next start."""
    count = Authority.open(home).withdraw(role or "edge", asset)
    if not count:
        raise click.UsageError(
            f"{asset or role} has no valid certificate, so there is nothing to revoke."
        )
    ERR.print(
        f"{plural(count, 'certificate')} revoked. Restart the router with the folder "
        "keys/router, so that it refuses them."
    )


def list_(home: Path) -> None:
    """Show the certificates issued, with their dates of expiry."""
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
