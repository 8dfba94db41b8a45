"""Arguments and help of the verb `record`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import (
    Name,
    Names,
    OutFile,
    Real,
    Size,
    connect_option,
    credentials_option,
)


@click.command(
    cls=Deferred,
    work="operation.record:record",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime record --out house.mcap
  slowtime record --out tower.mcap --asset demo.tower --duration 60
  slowtime record --out features.mcap --streams features,health
  slowtime record --out house.mcap --number --keep 4GB
""",
)
@click.option(
    "--out",
    required=True,
    type=OutFile(".mcap"),
    help="MCAP file to write; it must not exist yet.",
)
@connect_option
@credentials_option
@click.option(
    "--asset",
    default="*.*",
    show_default=True,
    type=Name(parts=2, any_=True),
    help="SITE.ASSET to record; * for any.",
)
@click.option(
    "--streams",
    type=Names(),
    help="Streams to record: a,b.  [default: all streams meant for recording]",
)
@click.option(
    "--duration",
    "duration_s",
    default=0.0,
    show_default=True,
    type=Real(min=0),
    help="Seconds to record; 0 until Ctrl-C.",
)
@click.option("--number", is_flag=True, help="If OUT exists, append a number to its name.")
@click.option(
    "--keep",
    "keep_bytes",
    type=Size(),
    help="Maximum total size of the files of OUT on disk, such as 4GB, including earlier "
    "numbered ones; a new file begins at one eighth of it.  [default: unlimited]",
)
@click.option(
    "--when-full",
    type=click.Choice(["drop-oldest", "stop"]),
    default="drop-oldest",
    show_default=True,
    help="With --keep: delete the oldest of these files, or end the recording with status 1.",
)
def record(out: Path, number: bool, **_given: object) -> None:
    """Record the messages of the bus into an MCAP file.

    Messages are on disk within a second of their arrival. `slowtime mcap recover` repairs the
    file of a killed recorder. Foxglove and Lichtblick open the result.
    """
    if out.exists() and not number:
        raise click.UsageError(
            f"{out} exists and may be the only copy of a recording. Give another name, or "
            "--number to have one put after it."
        )
