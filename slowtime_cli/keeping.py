"""The verbs `check`, `backup` and `restore`: what the twin has seen outlives its disk."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from twin_server.persist import WrongStoreError, audit_file, verify_file
from twin_server.persist import backup as copy_database
from twin_server.persist import restore as put_back

from . import ledgering
from .terminal import plural


def check(database: Path, *, ledger: bool, key: str | None, head: Path | None) -> None:
    """Look through a twin's database for damage, and for forgery."""
    if (key or head) and not ledger:
        raise click.UsageError(
            "--key and --head say what the ledger is held against: --ledger."
        )
    public = None if key is None else ledgering.public(key)
    kept = None if head is None else ledgering.kept(head)
    _refusing(lambda: verify_file(database, _tell))
    click.echo(f"{database} is sound.")
    if ledger:
        ledgering.report(
            _refusing(lambda: audit_file(database, public=public, kept=kept)), database, key
        )


def backup(database: Path, out: Path) -> None:
    """Copy a twin's database while the server writes it."""
    _refusing(lambda: copy_database(database, out, _tell))
    click.echo(f"{out} is whole and sound.")


def restore(copy: Path, database: Path) -> None:
    """Put a backup in the place of a twin's database."""
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
