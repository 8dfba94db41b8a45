"""Arguments and help of the verbs `backup` and `restore`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING


@click.command(
    cls=Deferred,
    work="operation.backup:backup",
    extra="twin",
    epilog="""\b
Examples:
  slowtime db backup twin.sqlite --out monday.sqlite
""",
)
@click.argument("database", type=EXISTING)
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write; it must not exist yet.",
)
def backup(**_given: object) -> None:
    """Copy a twin's database while the server is running.

    The copy shows one instant and contains everything acknowledged by then. It is checked
    before it is given its name, so a file with that name is complete and undamaged.
    """


@click.command(
    cls=Deferred,
    work="operation.backup:restore",
    extra="twin",
    epilog="""\b
Examples:
  slowtime db restore monday.sqlite --database twin.sqlite
""",
)
@click.argument("copy", type=EXISTING)
@click.option(
    "--database",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="Path of the twin server's database.",
)
def restore(**_given: object) -> None:
    """Restore a twin's database from a backup.

    Stop the server first. The current database is kept under a new name, which is printed.
    When the server starts, it requests the features since the backup from the edges. Edges hold
    only those that were never acknowledged. The others come from a recording: play it with
    `slowtime replay` before the edges connect, because features that no edge holds are then
    reported as lost, with their numbers, and refused afterwards.
    """
