"""Arguments and help of the verb `demo`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import OutFile, Real
from slowtime_cli.shared.settings import setting, settings_option


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
  slowtime demo --with frame             which storey of a frame weakens
  slowtime demo --with bridge            a crack under a swing of temperature
  slowtime demo --with story --data day  ten years of a house, and what its model lacks
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
    "--with",
    "wanted",
    multiple=True,
    type=click.Choice(["frame", "bridge", "story"]),
    help="Also a frame of three storeys with all its modes, which uses one processor core "
    "fully; a bridge in the weather; or, instead of all others, ten years of a house into "
    "which something enters that its model lacks.",
)
@click.option(
    "--data",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Keep database, spools and logs here.  [default: a temporary folder; of a story, "
    "house-SEED]",
)
@settings_option(
    setting(
        "--seed",
        default=1,
        show_default=True,
        type=click.IntRange(0, 2**31 - 1),
        help="Of --with story: decides what enters where, weather and noise.",
    ),
    setting(
        "--real-time",
        is_flag=True,
        help="Of --with story: measure as fast as the clock runs; ten years of ageing pass in "
        "--duration all the same.",
    ),
)
def demo(**_given: object) -> None:
    """Run router, edge agents, twin server and page on this computer.

    Simulated structures change in accelerated slow time; the twins track them from vibration
    alone. At the end it prints how often the 95 % intervals contained the true values.
    """
