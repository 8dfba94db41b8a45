"""The verb `recover`: a recording that breaks off in, a sound one out."""

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import OutFile

from .flags import EXISTING


@click.command(
    cls=Deferred,
    work="recovering:recover",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime recover killed.mcap --out sound.mcap
""",
)
@click.argument("damaged", type=EXISTING)
@click.option(
    "--out",
    required=True,
    type=OutFile(".mcap"),
    help="Sound file to write; it must not exist yet.",
)
def recover(**_given: object) -> None:
    """Make a recording sound again that was cut short or damaged.

    Everything that is whole in it is kept, indexed, and can be opened by any MCAP reader.
    """
