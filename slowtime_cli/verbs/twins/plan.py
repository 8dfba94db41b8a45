"""Arguments and help of the verb `plan`."""

from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import POSITIVE, Number, OutFile
from slowtime_cli.verbs.twins.twin_flags import refuse_incomplete_query, twin_flags


@click.command(
    cls=Deferred,
    work="twins.plan:plan",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime plan modes.json --registration twins.toml
  slowtime plan --server http://127.0.0.1:8000 --asset demo.tower
  slowtime plan --server http://127.0.0.1:8000 --fleet --teams 1 --window-d 30

Costs, failure and inspections stand in the registration (`costs` and `decision`):
docs/maintenance_plan.md.
""",
)
@twin_flags
@click.option("--fleet", is_flag=True, help="Rank all twins of the server for inspection.")
@click.option(
    "--teams",
    type=click.IntRange(1, 1000),
    default=1,
    show_default=True,
    help="For a fleet: number of inspection teams.",
)
@click.option(
    "--visits",
    type=click.IntRange(1, 1000),
    default=1,
    show_default=True,
    help="For a fleet: inspections that each team can make within the window.",
)
@click.option(
    "--window-d",
    type=POSITIVE,
    default=30.0,
    show_default=True,
    help="For a fleet: days within which teams inspect.",
)
@click.option(
    "--budget", type=Number(min=0), help="For a fleet: budget for all inspections together."
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout instead of the table.",
)
def plan(fleet: bool, server: str | None, source: object, **given: Any) -> None:
    """Recommend an action for a twin: repair, inspect, wait or close.

    Compares the options by their expected costs, and states the value of an inspection or of
    more readings and the costs at which the recommendation would change.
    """
    if fleet:
        if server is None or source is not None:
            raise click.UsageError("--fleet needs --server URL, and no SOURCE.")
        return
    refuse_incomplete_query(source=source, server=server, **given)
    if source is not None and given["registration"] is None:
        raise click.UsageError(
            "A plan needs costs and a decision. Give --registration FILE with both."
        )
