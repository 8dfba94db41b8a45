"""Arguments and help of the verb `plugins`."""

import click

from slowtime_cli.shared.deferred import Deferred


@click.command(
    cls=Deferred,
    fixed={"timeout_s": 30.0},
    work="operation.plugins:plugins",
    epilog="""\b
Examples:
  slowtime plugins

A plug-in is an entry point of an installed distribution, in the group slowtime.sources,
.readers, .effects, .identifiers or .alarms. Each is imported in a process of its own.
""",
)
def plugins(**_given: object) -> None:
    """List installed plug-ins.

    The exit status is 1 if a plug-in cannot be loaded.
    """
