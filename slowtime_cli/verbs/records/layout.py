"""Arguments and help of the verb `layout`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import OutFile


@click.command(
    cls=Deferred,
    work="records.layout:layout",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime mcap layout house.mcap --out house.layout.json

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
