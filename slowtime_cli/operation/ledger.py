"""The verb `ledger`: makes signing keys, fetches signed heads and verifies recordings."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slowtime_cli.shared.terminal import plural
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import Client
from slowtime_services.credentials import CredentialsError, make_key, public_key
from slowtime_services.credentials.timestamps import TimestampError, stamped
from slowtime_services.documents.document_files import read_json_file
from slowtime_services.ledger import Head, TreeHead, kept_of, last_head
from slowtime_services.ledger import verify as verify_proof
from slowtime_services.replay import RecordingError, verdicts

if TYPE_CHECKING:
    from twin_server.persist import Audit

MOST_BYTES_OF_A_STAMP = 1 << 20
"""Of an answer of a time-stamping authority, with its certificates [bytes]."""
SQLITE = b"SQLite format 3\0"
"""First bytes of a database file."""
TRIES = 3
"""Attempts to get two proofs for the same head; a server signs once a minute."""
HEADS_AT_ONCE = 1_000
"""Heads that are fetched at once; some 500 bytes each."""
URLS = ("postgresql://", "postgres://")
"""How the URL of a database begins."""


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


def head(server: str, out: Path, twin: str | None) -> None:
    """Fetch the newest signed head of a server, or of the chain of one twin."""
    with server_errors_told():
        _must_not_exist(out)
        if twin is not None:
            found = Client(server).tree_head(twin)
            out.write_text(json.dumps(found, indent=2) + "\n")
            click.echo(
                f"{out} has the head of {twin}, over the first {found['size']:,} entries of "
                "its chain. Keep it where the server cannot write."
            )
            return
        told = Client(server).json("GET", "/ledger/heads")
        heads, refusal = told["heads"], told.get("refusal", "")
        if not heads and not refusal:
            raise click.ClickException(
                f"{server} has no signing key, so it has signed nothing. Create one with "
                "`slowtime db ledger key` and start it with --ledger-key."
            )
        if heads:
            out.write_text(json.dumps(heads[-1], indent=2) + "\n")
            click.echo(
                f"{out} has head {heads[-1]['number']}. Keep it where the server cannot write."
            )
        if refusal:
            raise click.ClickException(f"{server} signs nothing behind it. {refusal}")


def prove(server: str, head: Path, reading: str | None, key: str | None, out: Path) -> None:
    """Fetch a proof that a server's ledger goes on from a kept head, and verify it."""
    with server_errors_told():
        _must_not_exist(out)
        kept, known = kept_head_of_any_kind(head), None if key is None else public_key_of(key)
        client = Client(server)
        if isinstance(kept, Head):
            if reading is not None:
                raise click.UsageError(
                    "A --reading is proven against the head of one twin. Give a --head of "
                    "`slowtime db ledger head --asset`."
                )
            told: dict[str, Any] = {"heads": _heads_from(client, kept.number)}
        else:
            told = _proof_of_twin(client, kept, reading)
        out.write_text(json.dumps(told, indent=2) + "\n")
        _print_proof(told, kept, out, known, key)


def _must_not_exist(out: Path) -> None:
    if out.exists():
        raise click.UsageError(
            f"{out} exists already. Give a new file name, or move that file away."
        )


def _heads_from(client: Client, number: int) -> list[dict[str, Any]]:
    """Fetch the head of a number and all behind it."""
    found: list[dict[str, Any]] = []
    last = number - 1
    while more := client.heads(after=last, limit=HEADS_AT_ONCE):
        found += more
        last = more[-1]["number"]
    return found


def _proof_of_twin(client: Client, kept: TreeHead, reading: str | None) -> dict[str, Any]:
    for _ in range(TRIES):
        consistency = client.consistency(kept.chain, kept.size)
        inclusion = None if reading is None else _inclusion(client, kept.chain, reading)
        if inclusion is None or inclusion["head"] == consistency["head"]:
            head = consistency["head"]
            return {"head": head, "consistency": consistency, "inclusion": inclusion}
    raise click.ClickException("The server signs faster than it is asked. Try again.")


def _inclusion(client: Client, twin: str, reading: str) -> dict[str, Any]:
    boot, _, sequence = reading.rpartition("/")
    if not boot or not sequence.isdecimal():
        raise click.UsageError(
            f"--reading {reading} was given. Give BOOT/SEQUENCE, such as b1/4711."
        )
    return client.inclusion(twin, boot, int(sequence))


def _print_proof(
    told: Any, kept: Head | TreeHead, path: Path, known: str | None, key: str | None
) -> None:
    try:
        found = verify_proof(told, kept, known)
    except ValueError as error:
        raise click.ClickException(f"{path} does not prove it: {error}.") from error
    if isinstance(found.head, Head):
        click.echo(
            f"The heads of the server go on from head {kept_name(found.kept)} to head "
            f"{found.head.number}{_by(key)}."
        )
        return
    click.echo(
        f"The chain of {found.head.chain} begins with the {kept_name(found.kept)} entries of "
        f"the kept head, and has {found.head.size:,}{_by(key)}."
    )
    if found.reading is not None:
        click.echo(
            f"Reading {found.reading.sequence} of boot {found.reading.boot} is entry "
            f"{found.reading.entry:,} of it."
        )


def kept_name(kept: Head | TreeHead) -> str:
    """Return the number of a head, or how many entries a tree head covers."""
    return f"{kept.number if isinstance(kept, Head) else kept.size:,}"


def verify(
    recording: str,
    key: str | None,
    head: Path | None,
    timestamp: Path | None,
    authority: Path | None,
) -> None:
    """Compare a recording or a database with the signed ledger, and a head with its stamp."""
    known = None if key is None else public_key_of(key)
    path = Path(recording)
    if path.is_file() and is_proof(path):
        _verify_proof_file(path, head, known, key)
        return
    kept = None if head is None else kept_head(head)
    if timestamp is not None or authority is not None:
        _verify_timestamp(kept, timestamp, authority)
    if recording.startswith(URLS):
        from twin_server.persist import without_secret

        print_audit(database_audit(recording, known, kept), without_secret(recording), key)
        return
    if not path.is_file():
        raise click.UsageError(f"There is no file {path}. Give a recording or a database.")
    with path.open("rb") as file:
        if file.read(len(SQLITE)) == SQLITE:
            print_audit(database_audit(path, known, kept), str(path), key)
            return
    _verify_recording(path, key, known, kept)


def is_proof(path: Path) -> bool:
    """Whether a file is a proof, which is JSON; no database or recording begins like it."""
    with path.open("rb") as file:
        return file.read(1) == b"{"


def _verify_proof_file(
    path: Path, head: Path | None, known: str | None, key: str | None
) -> None:
    if head is None:
        raise click.UsageError(
            f"{path} is a proof for a head that was kept. Give that with --head."
        )
    try:
        told = read_json_file(path)
    except ValueError as error:
        raise click.UsageError(f"{path} is no proof: {error}") from error
    _print_proof(told, kept_head_of_any_kind(head), path, known, key)


def database_audit(database: Path | str, public: str | None, kept: Head | None) -> "Audit":
    """Compare a database with its ledger; an error of the store becomes one of the command."""
    from twin_server.persist import WrongStoreError, audit_file, audit_url

    try:
        if isinstance(database, str):
            return audit_url(database, public=public, kept=kept)
        return audit_file(database, public=public, kept=kept)
    except WrongStoreError as error:
        raise click.ClickException(str(error)) from error


def _stamp(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MOST_BYTES_OF_A_STAMP)


def _verify_timestamp(
    kept: Head | None, timestamp: Path | None, authority: Path | None
) -> None:
    if kept is None or timestamp is None or authority is None:
        raise click.UsageError(
            "--timestamp is verified with the head that it stamps and the certificate of its "
            "authority: give --head, --timestamp and --authority together."
        )
    try:
        found = stamped(kept.hashed, _stamp(timestamp), authority)
    except TimestampError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"Head {kept.number} existed at {found.t:%Y-%m-%d %H:%M:%S} UTC ({timestamp}).")


def _verify_recording(
    recording: Path, key: str | None, known: str | None, kept: Head | None
) -> None:
    try:
        found = verdicts(recording, known, kept)
    except RecordingError as error:
        raise click.ClickException(str(error)) from error
    if not any(one.heads or one.wrong for one in found.values()):
        raise click.ClickException(
            f"{recording} has no signed head. Record while a server with a key runs "
            "(`slowtime db ledger key`)."
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
    if kept is not None and not any(one.has_kept for one in found.values()):
        raise click.ClickException(
            f"{recording} does not have head {kept.number}, which was kept elsewhere. Give a "
            "head of the time of the recording."
        )
    click.echo(f"{recording} is unchanged since it was accepted{_by(key)}.")


def print_audit(found: "Audit", database: str, key: str | None) -> None:
    """Print the result of comparing a database with its ledger."""
    for note in found.notes:
        click.echo(f"  {note}")
    if found.wrong:
        raise click.ClickException(
            f"{database} differs from what was accepted: {'; '.join(found.wrong[:5])}."
        )
    if found.against is None:
        click.echo(f"{database} agrees with its hash chains, but no signed head covers them.")
        return
    click.echo(
        f"{database} is as it was accepted{_by(key)}: "
        f"{found.vouched:,} ledger entries up to head {found.against.number}; "
        f"{found.waiting:,} since then, not covered by this head."
    )
    if found.replaced:
        named = ", ".join(f"{count:,} of {table}" for table, count in found.replaced.items())
        click.echo(
            f"  Of the rows that this head covers, some were written again or removed since: "
            f"{named}."
        )


def public_key_of(key: str) -> str:
    """Read a public key that was given."""
    try:
        return public_key(key)
    except CredentialsError as error:
        raise click.UsageError(str(error)) from error


def _last_document(path: Path) -> Any:
    """Read a JSON file, or the last line of one that has a document on each line."""
    try:
        return read_json_file(path)
    except ValueError:
        return last_head(path)._asdict()


def kept_head_of_any_kind(path: Path) -> Head | TreeHead:
    """Read a head that was kept, of a server or of the chain of one twin."""
    try:
        return kept_of(_last_document(path))
    except (ValueError, TypeError) as error:
        raise click.UsageError(
            f"{path} is not a head: {error} Give what `slowtime db ledger head` wrote."
        ) from error


def kept_head(path: Path) -> Head:
    """Read a head of a server that was kept."""
    try:
        return Head.of(_last_document(path))
    except (ValueError, TypeError) as error:
        raise click.UsageError(
            f"{path} is not a head: {error} Give what `slowtime db ledger head` wrote."
        ) from error


def _by(key: str | None) -> str:
    return "" if key else ", if the key in its heads is the server's (--key)"
