"""Arguments and help of the verb `plan`."""

from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.report_flags import report_flag, wording
from slowtime_cli.shared.settings import setting, settings_option
from slowtime_cli.verbs.twins.twin_flags import (
    EVENTS,
    UNREGISTERED,
    refuse_incomplete_query,
    registered_twin_flags,
)


@click.command(
    cls=Deferred,
    fixed=UNREGISTERED,
    work="twins.plan:plan",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin plan modes.json --registration twins.toml
  slowtime twin plan --server http://127.0.0.1:8000 --asset demo.tower
  slowtime twin plan modes.json --registration twins.toml --setting lead_time=40
  slowtime twin plan --server http://127.0.0.1:8000 --asset demo.tower --setting months=5-9
  slowtime twin plan --server http://127.0.0.1:8000 --fleet --setting teams=2

Costs, failure and inspections stand in the registration (`costs` and `decision`):
docs/maintenance_plan.md.
""",
)
@registered_twin_flags
@click.option("--fleet", is_flag=True, help="Rank all twins of the server for inspection.")
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout instead of the table.",
)
@report_flag
@settings_option(
    setting(
        "--lead-time",
        type=Real(min=0),
        help="From the order of a repair to its effect, in the unit of the costs; instead of "
        "the one registered.",
    ),
    setting(
        "--months",
        metavar="LIST",
        help="Months in which a repair can take effect, such as 5-9 or 4,5,9-11; instead of "
        "those registered.",
    ),
    setting(
        "--accepted",
        type=Real(min=0, max=1),
        help="Accepted probability of a failure before a repair takes effect, by which the "
        "last safe day is judged; instead of the one registered.",
    ),
    setting(
        "--teams",
        type=click.IntRange(1, 1000),
        default=1,
        show_default=True,
        help="For a fleet: number of inspection teams.",
    ),
    setting(
        "--visits",
        type=click.IntRange(1, 1000),
        default=1,
        show_default=True,
        help="For a fleet: inspections that each team can make within the window.",
    ),
    setting(
        "--window-d",
        type=POSITIVE,
        default=30.0,
        show_default=True,
        help="For a fleet: days within which teams inspect.",
    ),
    setting(
        "--budget", type=Real(min=0), help="For a fleet: budget for all inspections together."
    ),
    EVENTS,
    *wording(),
)
def plan(fleet: bool, server: str | None, source: object, **given: Any) -> None:
    """Recommend an action for a twin: repair, inspect, wait or close.

    Compares the options by their expected costs, and states the last safe day to order a
    repair, the value of an inspection or of more readings, and the costs at which the
    recommendation would change.
    """
    if fleet:
        if server is None or source is not None:
            raise click.UsageError("--fleet needs --server URL, and no SOURCE.")
        if {given.pop(name) for name in ("lead_time", "months", "accepted", "report")} != {
            None
        }:
            raise click.UsageError(
                "--report and the settings lead_time, months and accepted go with one twin. "
                "Leave --fleet out, or register them."
            )
        return
    if given["accepted"] in (0.0, 1.0):
        raise click.UsageError(
            "The setting accepted is a probability between 0 and 1, such as 0.02."
        )
    refuse_incomplete_query(source=source, server=server, **given)
    if source is not None and given["registration"] is None:
        raise click.UsageError(
            "A plan needs costs and a decision. Give --registration FILE with both."
        )
