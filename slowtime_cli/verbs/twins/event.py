"""Arguments and help of the verb `event`."""

from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, F, with_options
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import POSITIVE, Name, PlainText, Real, server_option
from slowtime_cli.shared.settings import setting, settings_option

KINDS = ("repair", "replacement", "inspection", "load_test", "note")
SHARE = Real(min=0, max=1)


def _slow_time_apart(
    ctx: click.Context, param: click.Parameter, moment: str | None
) -> str | None:
    """Hand on a moment of slow time under a name of its own."""
    if moment is None or not moment.startswith("slow:"):
        return moment
    ctx.params["slow_time"] = Real().convert(moment.removeprefix("slow:"), param, ctx)
    return None


PERSON = (
    click.option(
        "--person", type=PlainText(), help="Who reports it; by default the token's name."
    ),
    click.option(
        "--text",
        type=PlainText(),
        default="",
        help="Description of the work or observation.",
    ),
)
"""Who reports an event, and what he or she says."""


def person_flags(function: F) -> F:
    """Add the options of `PERSON`."""
    return with_options(PERSON, function)


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime twin event add lab.beam --kind repair --perfect --text "Bolts replaced"
  slowtime twin event add lab.beam --kind repair --restored-share 0.7 --sd 0.1 --at slow:812
  slowtime twin event add lab.beam --kind inspection --value -0.12 --sd 0.03
  slowtime twin event add lab.beam --kind inspection --not-detected \\
    --setting a50=0.1 --setting slope=2
  slowtime twin event add lab.beam --file events.json
  slowtime twin event list lab.beam
  slowtime twin event undo lab.beam work-order-118

The forecast of a twin restarts from a repair: docs/events.md.
""",
)
def event() -> None:
    """Record repairs and inspections of an asset, and undo them."""


@event.command(
    cls=Deferred, fixed={"slow_time": None}, work="twins.event:add", extra="analysis"
)
@click.argument("twin", type=Name(parts=2))
@click.option("--kind", type=click.Choice(KINDS), help="Kind of event.")
@click.option(
    "--at",
    metavar="MOMENT",
    callback=_slow_time_apart,
    help="When: RFC 3339 by the sensor's clock, or slow:NUMBER. By default after the latest "
    "reading.",
)
@click.option("--perfect", is_flag=True, help="Of a repair: all damage is restored.")
@click.option("--restored-share", type=SHARE, help="Of a repair: restored share of the damage.")
@click.option(
    "--sd", type=Real(min=0), help="Standard deviation of the share or the measured value."
)
@click.option("--value", type=Real(min=-1), help="Measured change, or that of a new part.")
@click.option(
    "--detected/--not-detected",
    default=None,
    help="Of an inspection: whether damage was found.",
)
@click.option(
    "--file", "file", type=EXISTING, help="JSON file of events, instead of the options above."
)
@click.option(
    "--id",
    "event",
    help="Id of the event; two reports with the same id are one event. By default derived from "
    "the content if a time is given, otherwise random.",
)
@person_flags
@server_option
@settings_option(
    setting(
        "--quantity",
        help="Affected quantity: stiffness_change, mass_change or an element; by default all.",
    ),
    setting("--a50", type=POSITIVE, help="Damage that is detected with probability 50 %."),
    setting("--slope", type=POSITIVE, help="Rise of the probit of detection over ln(damage)."),
    setting("--answers", help="event_id of the question that it answers."),
)
def add(kind: str | None, file: object, **given: Any) -> None:
    """Record an event of TWIN (SITE.ASSET); the same id twice is one event."""
    if (kind is None) == (file is None):
        raise click.UsageError("Give --kind, or --file FILE with events; one of them.")
    if given["perfect"] and given["restored_share"] is not None:
        raise click.UsageError("--perfect and --restored-share exclude each other.")


@event.command(cls=Deferred, work="twins.event:list_events", extra="analysis", name="list")
@click.argument("twin", type=Name(parts=2))
@server_option
def list_events(**_given: object) -> None:
    """List the events of TWIN (SITE.ASSET), and unanswered questions."""


@event.command(cls=Deferred, fixed={"event": None}, work="twins.event:undo", extra="analysis")
@click.argument("twin", type=Name(parts=2))
@click.argument("reverses", metavar="EVENT")
@person_flags
@server_option
def undo(**_given: object) -> None:
    """Undo EVENT of TWIN (SITE.ASSET): the forecast is as if it had not been reported.

    The event stays in the list, with the note that undid it.
    """
