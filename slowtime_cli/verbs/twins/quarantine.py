"""Arguments and help of the verb `quarantine`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import Name, server_option

NUMBER = click.IntRange(min=1)


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime twin quarantine list lab.beam
  slowtime twin quarantine release lab.beam 3
  slowtime twin quarantine drop lab.beam 3 --server https://twin.example

What is set aside, and why: docs/operating.md.
""",
)
def quarantine() -> None:
    """List, release and drop messages that the server set aside."""


@quarantine.command(
    cls=Deferred, work="twins.quarantine:list_aside", extra="analysis", name="list"
)
@click.argument("twin", type=Name(parts=2))
@server_option
def list_aside(**_given: object) -> None:
    """Show messages of TWIN (SITE.ASSET) whose processing exceeded its budget or failed."""


@quarantine.command(cls=Deferred, work="twins.quarantine:release", extra="analysis")
@click.argument("twin", type=Name(parts=2))
@click.argument("number", type=NUMBER)
@server_option
def release(**_given: object) -> None:
    """Try message NUMBER of TWIN (SITE.ASSET) again, and estimate its states anew with it."""


@quarantine.command(cls=Deferred, work="twins.quarantine:drop", extra="analysis")
@click.argument("twin", type=Name(parts=2))
@click.argument("number", type=NUMBER)
@server_option
def drop(**_given: object) -> None:
    """Delete message NUMBER of TWIN (SITE.ASSET); its place stays without an estimate."""
