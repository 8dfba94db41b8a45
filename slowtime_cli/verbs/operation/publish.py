"""Arguments and help of the verb `publish`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import POSITIVE, ROUTER, Endpoint, Real
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="operation.publish:publish",
    epilog="""\b
Examples:
  slowtime publish --to mqtt://127.0.0.1/bridge/accel
  slowtime publish --to zenoh:lab/bridge --frequency-hz 4.1
  slowtime publish --to - | slowtime edge --source 'stdin:?layout=csv&rate_hz=125'
""",
)
@click.option("--to", "url", required=True, metavar="URL", help="Destination; `-` to print.")
@click.option(
    "--rate-hz", type=POSITIVE, default=125.0, show_default=True, help="Samples per second."
)
@click.option(
    "--frequency-hz",
    type=POSITIVE,
    default=3.2,
    show_default=True,
    help="Natural frequency of the simulated structure.",
)
@click.option("--connect", type=Endpoint(), default=ROUTER, help="Router, for zenoh:.")
@settings_option(
    setting(
        "--seconds",
        type=POSITIVE,
        help="Seconds to run.  [default: until Ctrl-C]",
    ),
    setting(
        "--samples",
        type=click.IntRange(1, 10_000),
        default=25,
        show_default=True,
        help="Samples of one message.",
    ),
    setting(
        "--clock-error",
        type=Real(min=-0.05, max=0.05),
        default=0.0,
        show_default=True,
        help="Relative error of the sensor's clock; positive if fast.",
    ),
    setting(
        "--loss",
        type=Real(min=0, max=1),
        default=0.0,
        show_default=True,
        help="Share of messages lost.",
    ),
    setting(
        "--seed", type=click.IntRange(min=0), default=0, help="Seed of the random numbers."
    ),
)
def publish(**_given: object) -> None:
    """Simulate an acceleration sensor and publish its samples.

    It sends counts of an ADXL355 at +-2 g, 3.824e-5 m/s^2 each, of three axes, with a counter.
    """
