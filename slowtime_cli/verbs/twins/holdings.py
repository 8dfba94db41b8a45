"""Arguments and help of the verb `holdings`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import server_option


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime twin holdings list
  slowtime twin holdings cancel 9f86d081884c7d65 --server https://twin.example

Needed where a server answers that too much is under way (status 429 or 503). Tokens see what
counts for their sites; to cancel needs one of scope admin.
""",
)
def holdings() -> None:
    """Show what a server has under way for your sites, and end it."""


@holdings.command(cls=Deferred, work="twins.holdings:show_all", extra="analysis", name="list")
@server_option
def show_all(**_given: object) -> None:
    """Show uploads, replays, diagnoses, computations, exports and streams, the oldest first."""


@holdings.command(cls=Deferred, work="twins.holdings:cancel", extra="analysis")
@click.argument("holding")
@server_option
def cancel(**_given: object) -> None:
    """End what has the id HOLDING, as `slowtime twin holdings list` shows it."""
