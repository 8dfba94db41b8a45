"""Arguments and help of the verb `alarms`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import POSITIVE, Name, server_option


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime twin alarms test lab.beam
  slowtime twin alarms test lab.beam --receiver ops --server https://twin.example
  slowtime twin alarms deliveries lab.beam

Receivers stand in the settings of the twin server, routes to them in the registration of a
twin: docs/alarms_out.md.
""",
)
def alarms() -> None:
    """Send a test alarm of a twin, and show deliveries of alarms."""


@alarms.command(cls=Deferred, work="twins.alarms:send_test", extra="analysis", name="test")
@click.argument("twin", type=Name(parts=2))
@click.option("--receiver", help="One receiver, instead of all of the twin's routes.")
@click.option(
    "--wait-s",
    type=POSITIVE,
    default=30.0,
    show_default=True,
    help="How long to wait for the delivery.",
)
@server_option
def send_test(**_given: object) -> None:
    """Send a test alarm of TWIN (SITE.ASSET), and print which receivers it reached.

    The exit status is 1 if a receiver has not accepted it in time.
    """


@alarms.command(cls=Deferred, work="twins.alarms:deliveries", extra="analysis")
@click.argument("twin", type=Name(parts=2))
@server_option
def deliveries(**_given: object) -> None:
    """Show deliveries of TWIN (SITE.ASSET) by route, and the reasons of failures."""
