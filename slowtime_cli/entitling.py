"""The verb `tokens`: who may ask a twin server's REST and page, what, and until when."""

import datetime
from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from twin_server.serve.access import Scope, TokenFile, WrongNameError

from .options import Name
from .terminal import ERR

file_option = click.option(
    "--file",
    "path",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("tokens.json"),
    show_default=True,
    help="File of tokens; its key lies beside it.",
)


@click.group(
    epilog="""\b
Examples:
  slowtime tokens add ann --scope operator --site lab --days 30
  slowtime twin --tokens tokens.json --host 0.0.0.0 --behind-proxy
  slowtime tokens list
  slowtime tokens revoke 1a2b3c4d

A running server heeds changes from the next request on. The file holds no token, only what a
token can be recognised by.
"""
)
def tokens() -> None:
    """Make, list and revoke tokens for REST and the page."""


@tokens.command()
@click.argument("name")
@click.option(
    "--scope",
    type=click.Choice([scope.word for scope in Scope]),
    required=True,
    help="viewer sees; operator registers and diagnoses too; admin deletes too.",
)
@click.option(
    "--site",
    "sites",
    multiple=True,
    required=True,
    type=Name(any_=True),
    help="Site it reaches; may be given several times; * for all.",
)
@click.option(
    "--days",
    type=click.FloatRange(0, 3650, min_open=True),
    default=365,
    show_default=True,
    help="How long it is good.",
)
@file_option
def add(name: str, scope: str, sites: tuple[str, ...], days: float, path: Path) -> None:
    """Make a token for NAME and print it, this once."""
    try:
        text = TokenFile(path).add(name[:80], scope, sites, datetime.timedelta(days=days))
    except WrongNameError as error:
        raise click.UsageError(str(error)) from error
    click.echo(text)
    ERR.print("Keep it safe: it cannot be shown again.")


@tokens.command(name="list")
@file_option
def list_(path: Path) -> None:
    """Show whose tokens there are, and which are good."""
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


@tokens.command()
@click.argument("number")
@file_option
def revoke(number: str, path: Path) -> None:
    """Take back the token of that NUMBER, now."""
    token = TokenFile(path).revoke(number)
    ERR.print(f"The token of {token.name} lets nobody in any more.")
