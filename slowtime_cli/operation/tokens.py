"""The verb `tokens`: makes, lists and revokes tokens for REST and the page."""

import datetime
from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from slowtime_cli.shared.terminal import ERR
from twin_server.identity.tokens import TokenFile


def add(name: str, scope: str, sites: tuple[str, ...], days: float, path: Path) -> None:
    """Make a token for NAME and print it; it cannot be shown again."""
    text = TokenFile(path).add(name[:80], scope, sites, datetime.timedelta(days=days))
    click.echo(text)
    ERR.print("Keep it safe: it cannot be shown again.")


def list_(path: Path) -> None:
    """Show all tokens, and which are valid."""
    now = datetime.datetime.now(datetime.UTC)
    table = Table(box=SIMPLE_HEAD)
    for heading in ("number", "name", "scope", "sites", "until", ""):
        table.add_column(heading)
    for token in TokenFile(path).all():
        until = datetime.datetime.fromisoformat(token.expires)
        table.add_row(
            token.id,
            token.name,
            token.scope,
            " ".join(token.sites),
            f"{until:%Y-%m-%d %H:%M}Z",
            token.standing(now),
        )
    Console().print(table)


def revoke(number: str, path: Path) -> None:
    """Revoke the token of that NUMBER at once."""
    token = TokenFile(path).revoke(number)
    ERR.print(f"The token of {token.name} is revoked.")
