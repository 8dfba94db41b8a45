"""Arguments and help of the verb `separate`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Name, OutFile


@click.command(
    cls=Deferred,
    work="twins.separate:separate",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime separate modes.json --out scales.csv
  slowtime separate house.mcap --asset demo.tower
  slowtime separate history.csv --json

A text file has the columns slow_time, value and sd, or those that `slowtime evolve` reads.
""",
)
@click.argument("source", type=EXISTING)
@click.option(
    "--asset", type=Name(parts=2), help="SITE.ASSET, where a recording holds several."
)
@click.option(
    "--out",
    type=OutFile(),
    help="CSV file: both parts with standard deviation at each reading.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def separate(**_given: object) -> None:
    """Separate a history into a drift and a recurring part.

    Two slow time scales in one series (Chapter 8 of the book): a trend with a smooth process,
    and a wave, a sawtooth or an irregular fluctuation, as the readings support, each with its
    standard deviation. A mixture of Gaussian-process experts is compared with it by its
    predictions of readings that were left out.
    """
