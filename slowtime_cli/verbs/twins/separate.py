"""Arguments and help of the verb `separate`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Name
from slowtime_cli.shared.outputs import out_option


@click.command(
    cls=Deferred,
    work="twins.separate:separate",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin separate modes.json --out scales.csv
  slowtime twin separate house.mcap --asset demo.tower
  slowtime twin separate history.csv --out -

A text file has the columns slow_time, value and sd, or those that `slowtime twin evolve` reads.
""",
)
@click.argument("source", type=EXISTING)
@click.option(
    "--asset", type=Name(parts=2), help="SITE.ASSET, where a recording holds several."
)
@out_option("CSV file with both parts and their sd at each reading, or JSON.", ".csv", to="out")
def separate(**_given: object) -> None:
    """Separate a history into a drift and a recurring part.

    Two slow time scales in one series (Chapter 8 of the book): a trend with a smooth process,
    and a wave, a sawtooth or an irregular fluctuation, as the readings support, each with its
    standard deviation. A mixture of Gaussian-process experts is compared with it by its
    predictions of readings that were left out.
    """
