"""The verb `layout`: a recording in, what Foxglove and Lichtblick shall show of it out."""

import json
from pathlib import Path

import click

from slowtime_services.replay import RecordingError, contents, layout_of

from .options import OutFile


@click.command(
    epilog="""\b
Examples:
  slowtime layout house.mcap --out house.layout.json

Open the recording in Foxglove or Lichtblick, and import the layout there.
"""
)
@click.argument("recording", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--out", required=True, type=OutFile(".json"), help="Layout to write.")
def layout(recording: Path, out: Path) -> None:
    """Write a layout for Foxglove or Lichtblick that fits a recording.

    A tab for each asset: frequency, stiffness, mass and damping with their 95 % intervals,
    validity, health and events.
    """
    try:
        counts = contents(recording).counts
        whole = layout_of([topic for topic, count in counts.items() if count])
    except (RecordingError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    out.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    click.echo(f"{out}: {len(whole['configById']) - 1} panels")
