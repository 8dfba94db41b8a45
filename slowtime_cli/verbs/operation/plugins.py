"""Arguments and help of the verb `plugins`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import Real


@click.command(
    cls=Deferred,
    work="operation.plugins:plugins",
    epilog="""\b
Examples:
  slowtime plugins
  slowtime plugins --timeout-s 5

A plug-in is an entry point of an installed distribution, in the group slowtime.sources,
.readers, .effects, .identifiers or .alarms. Each is imported in a process of its own.
""",
)
@click.option(
    "--timeout-s",
    type=Real(min=0.1),
    default=30.0,
    show_default=True,
    help="How long the import of each may take.",
)
def plugins(**_given: object) -> None:
    """List installed plug-ins.

    The exit status is 1 if a plug-in cannot be loaded.
    """
