"""The verb `check`: audits the database of a twin for damage and forgery."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from slowtime_cli.operation.ledger import kept_head, print_audit, public_key_of
from slowtime_cli.shared.terminal import plural
from twin_server.persist import WrongStoreError, audit_file, verify_file

T = TypeVar("T")


def check(database: Path, *, ledger: bool, key: str | None, head: Path | None) -> None:
    """Check a twin's database for damage and forgery."""
    if (key or head) and not ledger:
        raise click.UsageError(
            "--key and --head say what the ledger is held against: --ledger."
        )
    public = None if key is None else public_key_of(key)
    kept = None if head is None else kept_head(head)
    database_errors_told(lambda: verify_file(database, print_progress))
    click.echo(f"{database} is sound.")
    if ledger:
        print_audit(
            database_errors_told(lambda: audit_file(database, public=public, kept=kept)),
            str(database),
            key,
        )


def print_progress(table: str, rows: int) -> None:
    """Print a table of a database and its number of rows."""
    click.echo(f"  {table}: {plural(rows, 'row')}")


def database_errors_told(work: Callable[[], T]) -> T:
    """Return the result of `work`; an error of the store becomes one of the command."""
    try:
        return work()
    except WrongStoreError as error:
        raise click.ClickException(str(error)) from error
