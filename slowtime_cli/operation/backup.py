"""The verbs `backup` and `restore`: copies the database of a twin, and puts a copy back."""

from pathlib import Path

import click

from slowtime_cli.operation.check import database_errors_told, print_progress
from twin_server.persist import backup as copy_database
from twin_server.persist import restore as put_back


def backup(database: Path, out: Path) -> None:
    """Copy a twin's database while the server writes it."""
    database_errors_told(lambda: copy_database(database, out, print_progress))
    click.echo(f"{out} is complete and undamaged.")


def restore(copy: Path, database: Path) -> None:
    """Replace a twin's database by a backup."""
    aside = database_errors_told(lambda: put_back(copy, database, print_progress))
    kept = f" The previous database was moved to {aside}." if aside else ""
    click.echo(f"{database} was restored from {copy}.{kept}")
