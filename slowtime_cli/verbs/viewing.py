"""The verb `layout`: a recording in, what Foxglove and Lichtblick shall show of it out."""

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import OutFile

from .flags import EXISTING


@click.command(
    cls=Deferred,
    work="viewing:layout",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime layout house.mcap --out house.layout.json

Open the recording in Foxglove or Lichtblick, and import the layout there.
""",
)
@click.argument("recording", type=EXISTING)
@click.option("--out", required=True, type=OutFile(".json"), help="Layout to write.")
def layout(**_given: object) -> None:
    """Write a layout for Foxglove or Lichtblick to fit a recording.

    A tab for each asset: frequency, stiffness, mass and damping with their 95 % intervals,
    validity, health and events.
    """
