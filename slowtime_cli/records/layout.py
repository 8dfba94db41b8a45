"""The verb `layout`: writes a layout of Foxglove and Lichtblick for a recording."""

import json
from pathlib import Path

import click

from slowtime_services.replay import RecordingError, contents, layout_of


def layout(recording: Path, out: Path) -> None:
    """Write a layout for Foxglove or Lichtblick to fit a recording."""
    try:
        whole = layout_of(contents(recording).topics)
    except (RecordingError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    out.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    click.echo(f"{out}: {len(whole['configById']) - 1} panels")
