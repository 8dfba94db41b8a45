"""Arguments and help of the verb `recover`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import OutFile


@click.command(
    cls=Deferred,
    work="records.recover:recover",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime mcap recover killed.mcap --out sound.mcap
""",
)
@click.argument("damaged", type=EXISTING)
@click.option(
    "--out",
    required=True,
    type=OutFile(".mcap"),
    help="File to write; it must not exist yet.",
)
def recover(**_given: object) -> None:
    """Repair a truncated or damaged recording.

    All readable messages are kept and indexed; any MCAP reader can open the result. Of a sound
    recording the many small chunks are joined, which makes those of slow readings smaller.
    """
