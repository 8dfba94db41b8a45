"""Arguments and help of the verbs `router` and `status`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import (
    ROUTER,
    Endpoint,
    Name,
    Real,
    connect_option,
    credentials_option,
)


@click.command(
    cls=Deferred,
    work="operation.router:router",
    epilog="""\b
Examples:
  slowtime router
  slowtime router --credentials keys/router --listen tls/0.0.0.0:7447
  slowtime router --listen tcp/127.0.0.1:7448 --connect tcp/10.0.0.2:7447
""",
)
@click.option(
    "--listen",
    multiple=True,
    type=Endpoint(),
    default=(ROUTER,),
    show_default=True,
    help="Endpoint to listen on; may be repeated.",
)
@click.option("--connect", multiple=True, type=Endpoint(), help="Another router to join.")
@credentials_option
@click.option(
    "--link",
    type=click.Choice(["lab", "field", "metered"]),
    default="lab",
    show_default=True,
    help="As the edge agents' own: how rarely keep-alives are sent to them (docs/edge.md).",
)
@click.option(
    "--insecure",
    is_flag=True,
    help="Accept all connections without certificates; all may read and write.",
)
def router(**_given: object) -> None:
    """Run a Zenoh router that edges, twin and recorder connect to.

    With credentials it accepts holders of a certificate of its site, each with the rights of
    its role. Without credentials it accepts local connections only.
    """


@click.command(
    cls=Deferred,
    work="operation.router:status",
    epilog="""\b
Examples:
  slowtime router status
  slowtime router status --asset demo.tower && echo "the tower's edge agent is online"
""",
)
@connect_option
@credentials_option
@click.option("--asset", type=Name(parts=2), help="SITE.ASSET that must be online.")
@click.option(
    "--timeout-s",
    default=4.0,
    show_default=True,
    type=Real(min=0.1),
    help="How long to wait.",
)
def status(**_given: object) -> None:
    """Show whether the router answers, and which edges are online.

    Edges are the computers beside the sensors. The exit status is 0 if the router answers and
    all edges are online, otherwise 1: suitable for health checks.
    """
