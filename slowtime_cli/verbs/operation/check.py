"""Arguments and help of the verb `check`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, key_option


@click.command(
    cls=Deferred,
    work="operation.check:check",
    extra="twin",
    epilog="""\b
Examples:
  slowtime db check twin.sqlite
  slowtime db check monday.sqlite && echo "it can be restored"
  slowtime db check twin.sqlite --ledger --key ledger.pem.pub --head head.json
""",
)
@click.argument("database", type=EXISTING)
@click.option("--ledger", is_flag=True, help="Compare each row with the signed ledger.")
@key_option
@click.option(
    "--head",
    type=EXISTING,
    help="A head kept elsewhere (`slowtime db ledger head`), to detect a truncated history.",
)
def check(**_given: object) -> None:
    """Check a twin's database for damage.

    Checksums of every page and row and the number of rows are verified. The server may keep
    writing. The exit status is 0 if there is no damage, and otherwise 2, with a message.

    This detects decay. With --ledger it also detects forgery: rows that were changed,
    inserted, deleted or moved together with their checksums.
    """
