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
    """Check a twin's database for damage.

    Every page, every row and the number of rows is compared with what was written. A server
    may go on writing meanwhile. Leaves with 0 where all is sound, with 2 and a sentence where
    anything is not.

    That finds decay. With --ledger it finds forgery, too: rows that somebody changed, put in,
    took out or moved, checksums and all.
    """
