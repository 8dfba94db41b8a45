"""Arguments and help of the verb `forecast`."""

from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import CHANGES, LEARN_EPOCHS
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.settings import setting, settings_option
from slowtime_cli.verbs.twins.twin_flags import (
    events_option,
    refuse_incomplete_query,
    twin_flags,
)


@click.command(
    cls=Deferred,
    work="twins.forecast:forecast",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin forecast modes.json --nominal-hz 4 --threshold -0.2
  slowtime twin forecast house.mcap --asset demo.tower --nominal-hz 5 --horizon 200
  slowtime twin forecast house.mcap --asset demo.tower --nominal-hz 5 --events events.json
  slowtime twin forecast --server http://127.0.0.1:8000 --asset demo.tower --threshold -0.3

SOURCE is what `slowtime twin evolve` takes: the file of `slowtime identify --window-s`, a
recording of features, or text with the columns slow_time, frequency_hz, frequency_sd.
""",
)
@twin_flags
@events_option
@click.option(
    "--horizon",
    type=POSITIVE,
    help="Horizon, in the unit of slow time: seconds for a file of modes or a sensor, days "
    "for a simulated structure. The command prints the unit.",
)
@click.option(
    "--threshold",
    type=Real(min=-1),
    help="Threshold of a change, besides those of the registration.",
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout instead of the table.",
)
@settings_option(
    setting("--quantity", help="Quantity of the threshold, if several are estimated."),
    setting(
        "--points",
        type=click.IntRange(1, 200),
        default=20,
        show_default=True,
        help="Number of future times.",
    ),
    setting(
        "--toward",
        type=click.Choice(["below", "above"]),
        help="Direction of crossing; by default from the present side.",
    ),
    CHANGES,
    LEARN_EPOCHS,
)
def forecast(**given: Any) -> None:
    """Forecast the changes of a twin, and when they reach thresholds.

    Prints mean and 95 % interval of each change, such as that of stiffness, at future instants
    of the slow time, over which the structure changes, such as days; and for each threshold the
    times by which it is reached with 10, 50 and 90 % probability, as far as they are within
    the horizon.
    """
    refuse_incomplete_query(**given)
