"""The verbs `check`, `backup` and `restore`: what the twin has seen outlives its disk."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred

from .flags import EXISTING, key_option


@click.command(
    cls=Deferred,
    work="keeping:check",
    extra="twin",
    epilog="""\b
Examples:
  slowtime check twin.sqlite
  slowtime check monday.sqlite && echo "it can be restored"
  slowtime check twin.sqlite --ledger --key ledger.pem.pub --head head.json
""",
)
@click.argument("database", type=EXISTING)
@click.option(
    "--ledger", is_flag=True, help="Compare each row with what was signed when it was accepted."
)
@key_option
@click.option(
    "--head",
    type=EXISTING,
    help="A head that was kept elsewhere (`slowtime ledger head`): shows a cut end.",
)
def check(**_given: object) -> None:
    """Look through a twin's database for damage.

    Every page, every row and the number of rows is compared with what was written. A server
    may go on writing meanwhile. Leaves with 0 where all is sound, with 2 and a sentence where
    anything is not.

    That finds decay. With --ledger it finds forgery, too: rows that somebody changed, put in,
    took out or moved, checksums and all.
    """


@click.command(
    cls=Deferred,
    work="keeping:backup",
    extra="twin",
    epilog="""\b
Examples:
  slowtime backup twin.sqlite --out monday.sqlite
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
    """Copy a twin's database while the server writes it.

    The copy is of one moment: everything acknowledged by then is in it. It is looked through
    before it gets its name, so that a file of that name is whole and sound.
    """


@click.command(
    cls=Deferred,
    work="keeping:restore",
    extra="twin",
    epilog="""\b
Examples:
  slowtime restore monday.sqlite --database twin.sqlite
""",
)
@click.argument("copy", type=EXISTING)
@click.option(
    "--database",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="Where the twin server shall find it.",
)
def restore(**_given: object) -> None:
    """Put a backup in the place of a twin's database.

    End the server first. What was there is kept aside. Features that came after the backup are
    asked from the edges again when the server starts; those that an edge no longer holds are
    reported as lost, with their range.
    """
