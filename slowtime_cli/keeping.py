"""The verbs `check`, `backup` and `restore`: what the twin has seen outlives its disk."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from twin_server.persist import WrongStoreError, look_through
from twin_server.persist import backup as copy_database
from twin_server.persist import restore as put_back

from .terminal import plural

DATABASE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command(
    epilog="""\b
Examples:
  slowtime check twin.sqlite
  slowtime check monday.sqlite && echo "it can be restored"
"""
)
@click.argument("database", type=DATABASE)
def check(database: Path) -> None:
    """Look through a twin's database for damage.

    Every page, every row and the number of rows is compared with what was written. A server
    may go on writing meanwhile. Leaves with 0 where all is sound, with 2 and a sentence where
    anything is not.
    """
    _refusing(lambda: look_through(database, _tell))
    click.echo(f"{database} is sound.")


@click.command(
    epilog="""\b
Examples:
  slowtime backup twin.sqlite --out monday.sqlite
"""
)
@click.argument("database", type=DATABASE)
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write; it must not exist yet.",
)
def backup(database: Path, out: Path) -> None:
    """Copy a twin's database while the server writes it.

    The copy is of one moment: everything acknowledged by then is in it. It is looked through
    before it gets its name, so that a file of that name is whole and sound.
    """
    _refusing(lambda: copy_database(database, out, _tell))
    click.echo(f"{out} is whole and sound.")


@click.command(
    epilog="""\b
Examples:
  slowtime restore monday.sqlite --database twin.sqlite
"""
)
@click.argument("copy", type=DATABASE)
@click.option(
    "--database",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="Where the twin server shall find it.",
)
def restore(copy: Path, database: Path) -> None:
    """Put a backup in the place of a twin's database.

    End the server first. What was there is kept aside. Features that came after the backup are
    asked from the edges again when the server starts; those that an edge no longer holds are
    reported as lost, with their range.
    """
    aside = _refusing(lambda: put_back(copy, database, _tell))
    kept = f" What was there is {aside} now." if aside else ""
    click.echo(f"{database} is as {copy} was.{kept}")


def _tell(table: str, rows: int) -> None:
    click.echo(f"  {table}: {plural(rows, 'row')}")


T = TypeVar("T")


def _refusing(work: Callable[[], T]) -> T:
    """Say in a sentence what is wrong with a database."""
    try:
        return work()
    except WrongStoreError as error:
        raise click.ClickException(str(error)) from error
