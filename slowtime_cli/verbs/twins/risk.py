"""Arguments and help of the verb `risk`."""

from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import POSITIVE, OutFile
from slowtime_cli.shared.settings import settings_option
from slowtime_cli.verbs.twins.twin_flags import (
    EVENTS,
    UNREGISTERED,
    refuse_incomplete_query,
    registered_twin_flags,
)


@click.command(
    cls=Deferred,
    fixed=UNREGISTERED,
    work="twins.risk:risk",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin risk modes.json --registration twins.toml --horizon 100
  slowtime twin risk --server http://127.0.0.1:8000 --asset demo.tower

Limit states stand in the registration (`limit_states`): docs/risk.md.
""",
)
@registered_twin_flags
@click.option(
    "--horizon",
    type=POSITIVE,
    help="Horizon, in the unit of slow time: seconds for a file of modes or a sensor, days "
    "for a simulated structure. `slowtime twin forecast` prints the unit.",
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout instead of the table.",
)
@settings_option(
    EVENTS,
)
def risk(server: str | None, source: object, **given: Any) -> None:
    """Compute a twin's probability of failure for each limit state.

    A limit state is a change that passes a threshold, a frequency that coincides with an
    excitation, a response to a load event that exceeds a capacity, or a limit state of your
    own. Gives the probability now with its 90 % interval, the reliability index, the
    probability up to the horizon, and when the accepted probability is reached.
    """
    refuse_incomplete_query(source=source, server=server, **given)
    if source is not None and given["registration"] is None:
        raise click.UsageError(
            "A risk needs limit states. Give --registration FILE with `limit_states`."
        )
