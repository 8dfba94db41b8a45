"""The verb `ledger`: makes signing keys, fetches signed heads and verifies recordings."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from slowtime_cli.shared.terminal import plural
from slowtime_services.client import Client
from slowtime_services.credentials import CredentialsError, make_key, public_key
from slowtime_services.documents.document_files import read_json_file
from slowtime_services.ledger import Head
from slowtime_services.replay import RecordingError, verdicts

if TYPE_CHECKING:
    from twin_server.persist import Audit


def key(out: Path) -> None:
    """Make a key to sign with."""
    try:
        made = make_key(out)
    except CredentialsError as error:
        raise click.ClickException(str(error)) from error
    click.echo(
        f"{out} is the private key for signing; {made} ({out}.pub) is the public key for "
        "verification."
    )


def head(server: str, out: Path) -> None:
    """Fetch the newest signed head."""
    if out.exists():
        raise click.UsageError(
            f"{out} exists already. Give a new file name, or move that file away."
        )
    found = Client(server).heads()
    if not found:
        raise click.ClickException(
            f"{server} has no signing key, so it has signed nothing. Create one with "
            "`slowtime ledger key` and start it with --ledger-key."
        )
    out.write_text(json.dumps(found[-1], indent=2) + "\n")
    click.echo(f"{out} has head {found[-1]['number']}. Keep it where the server cannot write.")


def verify(recording: Path, key: str | None) -> None:
    """Compare the features of a recording with the signed ledger."""
    known = None if key is None else public_key_of(key)
    try:
        found = verdicts(recording, known)
    except RecordingError as error:
        raise click.ClickException(str(error)) from error
    if not any(one.heads or one.wrong for one in found.values()):
        raise click.ClickException(
            f"{recording} has no signed head. Record while a server with a key runs "
            "(`slowtime ledger key`)."
        )
    wrong = []
    for asset, one in found.items():
        click.echo(
            f"  {asset}: {plural(one.vouched, 'feature')} as accepted, covered by "
            f"{plural(one.heads, 'head')}; {one.waiting:,} before the first or after the last; "
            f"{one.missing:,} accepted and not recorded"
        )
        wrong += [f"{asset}: {what}" for what in one.wrong]
    if wrong:
        raise click.ClickException(f"{recording} has been changed: {'; '.join(wrong[:5])}.")
    click.echo(f"{recording} is unchanged since it was accepted{_by(key)}.")


def print_audit(found: "Audit", database: Path, key: str | None) -> None:
    """Print the result of comparing a database with its ledger."""
    for note in found.notes:
        click.echo(f"  {note}")
    if found.wrong:
        raise click.ClickException(
            f"{database} differs from what was accepted: {'; '.join(found.wrong[:5])}."
        )
    if found.last is None:
        click.echo(f"{database} agrees with its hash chains, but no signed head covers them.")
        return
    click.echo(
        f"{database} is as it was accepted{_by(key)}: "
        f"{plural(found.vouched, 'accepted row')} up to head {found.last.number}; "
        f"{found.waiting:,} since then, not yet covered by a signed head."
    )


def public_key_of(key: str) -> str:
    """Read a public key that was given."""
    try:
        return public_key(key)
    except CredentialsError as error:
        raise click.UsageError(str(error)) from error


def kept_head(path: Path) -> Head:
    """Read a head that was kept."""
    try:
        return Head.of(read_json_file(path))
    except (ValueError, TypeError) as error:
        raise click.UsageError(
            f"{path} is not a head: {error} Give what `slowtime ledger head` wrote."
        ) from error


def _by(key: str | None) -> str:
    return "" if key else ", if the key in its heads is the server's (--key)"
