"""Arguments and help of the verb `tokens`."""

from collections.abc import Callable
from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, F
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import Name, PlainText

SCOPES = ("viewer", "operator", "admin")


def _file(kind: click.Path) -> Callable[[F], F]:
    return click.option(
        "--file",
        "path",
        type=kind,
        default=Path("tokens.json"),
        show_default=True,
        help="File of tokens; its key is beside it.",
    )


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime tokens add ann --scope operator --site lab --days 30
  slowtime twin --tokens tokens.json --host 0.0.0.0 --behind-proxy
  slowtime tokens list
  slowtime tokens revoke 1a2b3c4d

A running server applies changes from the next request on. The file holds hashes of tokens.
""",
)
def tokens() -> None:
    """Create, list and revoke tokens for REST and the page."""


@tokens.command(cls=Deferred, work="operation.tokens:add", extra="twin")
@click.argument("name", type=PlainText())
@click.option(
    "--scope",
    type=click.Choice(SCOPES),
    required=True,
    help="viewer reads; operator also registers and diagnoses; admin also deletes.",
)
@click.option(
    "--site",
    "sites",
    multiple=True,
    required=True,
    type=Name(any_=True),
    help="Site that the token gives access to; may be repeated; * for all.",
)
@click.option(
    "--days",
    type=click.FloatRange(0, 3650, min_open=True),
    default=365,
    show_default=True,
    help="How long the token is valid.",
)
@_file(click.Path(dir_okay=False, path_type=Path))
def add(**_given: object) -> None:
    """Make a token for NAME and print it; it cannot be shown again."""


@tokens.command(cls=Deferred, work="operation.tokens:list_", extra="twin", name="list")
@_file(EXISTING)
def list_(**_given: object) -> None:
    """Show all tokens, and which are valid."""


@tokens.command(cls=Deferred, work="operation.tokens:revoke", extra="twin")
@click.argument("number")
@_file(EXISTING)
def revoke(**_given: object) -> None:
    """Revoke the token of that NUMBER at once."""
