"""Arguments and help of the verb `orders`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import record_flags
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="records.orders:orders",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime modes orders runup.csv --rate-hz 2000 --tacho pulse --orders 1,2,3
  slowtime modes orders runup.csv --tacho pulse --orders 0.5,1 --setting pulses=60 \\
    --out orders.csv

Peak amplitudes are in the unit of each channel; phases are those of a cosine at the first
pulse.
""",
)
@record_flags
@click.option("--tacho", required=True, help="Channel with pulses of the shaft.")
@click.option(
    "--orders",
    "wanted",
    required=True,
    metavar="ORDER,...",
    help="Multiples of the speed: 1,2,3.",
)
@out_option("CSV or JSON file to write.", ".csv", ".json", to="out")
@settings_option(
    setting(
        "--pulses",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Pulses in a revolution.",
    ),
    setting(
        "--revolutions",
        type=click.IntRange(min=1),
        default=16,
        show_default=True,
        help="Revolutions in a block; orders closer than two over this number are refused.",
    ),
)
def orders(record_path: Path, **_given: object) -> None:
    """Track the orders of a rotating machine, with a tacho signal.

    The record is resampled to equal steps of shaft angle, and the amplitudes of all orders are
    fitted block by block, with standard deviations from the residual.
    """
