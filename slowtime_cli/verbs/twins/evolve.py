"""Arguments and help of the verb `evolve`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import (
    EXISTING,
    LEARN_EPOCHS,
    as_built,
    changes_option,
    refuse_damping_alone,
)
from slowtime_cli.shared.options import Name, OutFile
from slowtime_cli.shared.report_flags import report_flag, wording
from slowtime_cli.shared.settings import settings_option


@click.command(
    cls=Deferred,
    work="twins.evolve:evolve",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin evolve modes.json --nominal-hz 5 --out states.json
  slowtime twin evolve house.mcap --asset demo.tower --nominal-hz 5 --nominal-damping 0.01
  slowtime twin evolve frequencies.csv --changes mass --out evolution.json

A text file has a header and, between commas, semicolons or tabs, the columns slow_time,
frequency_hz, frequency_sd and, where the damping is known, damping_ratio and damping_sd.
""",
)
@click.argument("source", type=EXISTING)
@changes_option
@as_built
@click.option(
    "--asset", type=Name(parts=2), help="SITE.ASSET, where a recording holds several."
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, {points: [state, ...]}; - for stdout instead of the table.",
)
@report_flag
@settings_option(LEARN_EPOCHS, *wording())
def evolve(nominal_hz: float | None, nominal_damping: float | None, **_given: object) -> None:
    """Estimate changes of stiffness and mass from frequencies.

    SOURCE is the output of `slowtime identify --window-s`, an MCAP recording of features, or a
    text file. The larger the standard deviation of a time window's frequency, the less the
    window counts. Overlapping windows (`--hop-s` below `--window-s`) count less, because they
    share samples.
    """
    refuse_damping_alone(nominal_hz, nominal_damping)
