"""Arguments and help of the verb `demo`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import OutFile, Real


@click.command(
    cls=Deferred,
    fixed={"epochs_per_s": 5.0},
    work="operation.demo:demo",
    extra="twin",
    epilog="""\b
Examples:
  slowtime demo                          until Ctrl-C, page on http://127.0.0.1:8000
  slowtime demo --port 8080 --duration 90
  slowtime demo --record house.mcap --duration 60
  slowtime demo --frame                  which storey of a frame weakens
  slowtime demo --bridge                 a crack under a swing of temperature
""",
)
@click.option(
    "--port",
    default=8000,
    show_default=True,
    type=click.IntRange(1, 65535),
    help="Port of the page and of REST.",
)
@click.option(
    "--duration",
    "duration_s",
    default=0.0,
    show_default=True,
    type=Real(min=0),
    help="Seconds to run; 0 until Ctrl-C.",
)
@click.option(
    "--record",
    "recording",
    type=OutFile(".mcap"),
    help="Also record all messages, raw blocks included, into this MCAP file.",
)
@click.option(
    "--frame",
    "with_frame",
    is_flag=True,
    help="Also a frame of three storeys, with all its modes; it uses one processor core fully.",
)
@click.option(
    "--bridge",
    "with_bridge",
    is_flag=True,
    help="Also a bridge whose frequency varies with the temperature.",
)
@click.option(
    "--data",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Keep database, spools and logs here.  [default: a temporary folder]",
)
def demo(**_given: object) -> None:
    """Run router, edge agents, twin server and page on this computer.

    Simulated structures change in accelerated slow time; the twins track them from vibration
    alone. At the end it prints how often the 95 % intervals contained the true values.
    """
