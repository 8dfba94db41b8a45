"""Arguments and help of the verb `ledger`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, key_option
from slowtime_cli.shared.help_pages import DocumentedGroup


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime db ledger key ledger.pem
  slowtime twin --ledger-key ledger.pem
  slowtime db ledger head --server http://127.0.0.1:8000 --out head.json
  slowtime db ledger head --server http://127.0.0.1:8000 --asset lab.beam --out beam.json
  slowtime db ledger prove --server http://127.0.0.1:8000 --head beam.json --out proof.json
  slowtime db check twin.sqlite --ledger --key ledger.pem.pub --head head.json
  slowtime db ledger verify proof.json --key ledger.pem.pub --head beam.json
  slowtime db ledger verify house.mcap --key ledger.pem.pub
  slowtime db ledger verify postgresql://twin@db/house --key ledger.pem.pub --head head.json

A server with a key signs, once a minute, one hash over all that it has accepted. Keep the
public key and now and then a head where the machine of the server cannot write: whoever forges
the database has to forge those, too.
""",
)
def ledger() -> None:
    """Verify that a twin's history was not altered or deleted.

    The ledger is a chain of hashes over all features that the twin server accepted, signed by
    it. Where a feature was changed or deleted afterwards, the chain no longer fits.
    """


@ledger.command(cls=Deferred, work="operation.ledger:key", extra="twin")
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
def key(**_given: object) -> None:
    """Create a signing key: the private key in OUT, the public key in OUT.pub.

    Give OUT to the twin server (`slowtime twin --ledger-key OUT`) and keep it secret; give
    OUT.pub to those who verify.
    """


@ledger.command(cls=Deferred, work="operation.ledger:head", extra="analysis")
@click.option("--server", required=True, help="Address of the twin server.")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write; it must not exist yet.",
)
@click.option(
    "--asset",
    "twin",
    metavar="SITE.ASSET",
    help="Fetch the head of the chain of this twin only.",
)
def head(**_given: object) -> None:
    """Fetch the newest signed head of the ledger, to be kept elsewhere.

    Without --asset it is the head of the whole server, which needs a token of all sites. If the
    server signs nothing any more, the last head is written, and the exit status is not 0.
    """


@ledger.command(cls=Deferred, work="operation.ledger:prove", extra="analysis")
@click.option("--server", required=True, help="Address of the twin server.")
@click.option(
    "--head",
    required=True,
    type=EXISTING,
    help="A head that was kept (`slowtime db ledger head`).",
)
@click.option("--reading", help="Prove this reading, too: BOOT/SEQUENCE.")
@key_option
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write; it must not exist yet.",
)
def prove(**_given: object) -> None:
    """Fetch a proof that the ledger goes on from a head that was kept, and verify it.

    With the head of a twin it is a consistency proof of its chain, and with --reading an
    inclusion proof (RFC 9162). With the head of a server it is the heads behind it. Later,
    `slowtime db ledger verify` verifies the file without the server.
    """


@ledger.command(cls=Deferred, work="operation.ledger:verify", extra="analysis")
@click.argument("recording", metavar="RECORDING|DATABASE|PROOF")
@key_option
@click.option(
    "--head",
    type=EXISTING,
    help="A head kept elsewhere: a file of `slowtime db ledger head`, or one of "
    "`witness_file`.",
)
@click.option("--timestamp", type=EXISTING, help="Time stamp of this head (RFC 3161, .tsr).")
@click.option("--authority", type=EXISTING, help="Root certificate of the authority, PEM.")
def verify(**_given: object) -> None:
    """Compare a recording or a database with the signed ledger, or verify a proof.

    DATABASE is a file or the URL of a PostgreSQL database. What lies behind the head is
    reported as not covered. The exit status is 0 if nothing was changed, and otherwise 2, with
    a message.
    """
