"""The verbs `record` and `replay`: from the bus to a file, and back."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import (
    POSITIVE,
    Name,
    Number,
    OutFile,
    Size,
    connect_option,
    credentials_option,
    together,
)

from .flags import EXISTING


@click.command(
    cls=Deferred,
    work="recording:record",
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
@click.option("--streams", help="Streams to record: a,b.  [default: all that are meant for it]")
@click.option(
    "--duration",
    "duration_s",
    default=0.0,
    show_default=True,
    type=Number(min=0),
    help="Seconds to record; 0 until Ctrl-C.",
)
@click.option("--number", is_flag=True, help="Where OUT exists, put a number after its name.")
@click.option(
    "--keep",
    "keep_bytes",
    type=Size(),
    help="Most that the files of OUT, numbered ones of before among them, take on the disk, "
    "such as 4GB; at an eighth of it another file begins.  [default: no bound]",
)
@click.option(
    "--when-full",
    type=click.Choice(["drop-oldest", "stop"]),
    default="drop-oldest",
    show_default=True,
    help="With --keep: delete the oldest of these files, or end the recording with status 1.",
)
def record(out: Path, number: bool, **_given: object) -> None:
    """Record what travels on the bus into an MCAP file.

    What has arrived is on the disk within a second; a file left by a killed recorder is made
    sound again by `slowtime recover`. Foxglove and Lichtblick open the result.
    """
    if out.exists() and not number:
        raise click.UsageError(
            f"{out} exists and may be the only copy of a recording. Give another name, or "
            "--number to have one put after it."
        )


@click.command(
    cls=Deferred,
    work="recording:replay",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime replay house.mcap                             onto the bus, as it was
  slowtime replay house.mcap --fast --server http://127.0.0.1:8000
  slowtime replay house.mcap --into fresh.sqlite         straight into a twin, no network
  slowtime replay house.mcap --edge                      raw blocks through the edge again
""",
)
@click.argument("recording", type=EXISTING)
@connect_option
@credentials_option
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=POSITIVE,
    help="Pace; 1 as it was.",
)
@click.option("--fast", is_flag=True, help="As fast as the twin acknowledges.")
@click.option(
    "--server",
    metavar="URL",
    help="Twin server to ask for the hash of its history; with the token in SLOWTIME_TOKEN, "
    "where it wants one.",
)
@click.option(
    "--into",
    "database",
    type=OutFile(),
    help="New SQLite file: run through a twin here, without any bus.",
)
@click.option(
    "--edge",
    is_flag=True,
    help="Run raw blocks through the edge agent and compare its features to those recorded.",
)
def replay(edge: bool, database: Path | None, server: str | None, **_given: object) -> None:
    """Play a recording again and print the hash of its history.

    The same recording gives the same history, bit for bit, at any speed.
    """
    together([("--edge", edge), ("--into", database), ("--server", server)])
