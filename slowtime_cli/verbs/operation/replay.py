"""Arguments and help of the verb `replay`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import (
    OutFile,
    Real,
    connect_option,
    credentials_option,
    together,
)


def _pace(ctx: click.Context, _param: click.Parameter, speed: float) -> float:
    """Ask for the highest pace where the speed is 0."""
    ctx.params["fast"] = speed == 0
    return speed or 1.0


@click.command(
    cls=Deferred,
    fixed={"fast": False},
    work="operation.replay:replay",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime replay house.mcap                             onto the bus, as it was
  slowtime replay house.mcap --speed 0 --server http://127.0.0.1:8000
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
    type=Real(min=0),
    callback=_pace,
    help="Pace: 1 as recorded, 0 as fast as the twin acknowledges.",
)
@click.option(
    "--server",
    metavar="URL",
    help="Twin server to ask for the hash of its history; its token, if it needs one, in "
    "SLOWTIME_TOKEN.",
)
@click.option(
    "--into",
    "database",
    type=OutFile(),
    help="New SQLite file: replay into a twin in this process, without a bus.",
)
@click.option(
    "--edge",
    is_flag=True,
    help="Run raw blocks through the edge agent and compare its features to those recorded.",
)
def replay(edge: bool, database: Path | None, server: str | None, **_given: object) -> None:
    """Replay a recording and print the hash of its history.

    The same recording gives the same history, bit for bit, at any speed.
    """
    together([("--edge", edge), ("--into", database), ("--server", server)])
