"""Arguments of the verb `doctor`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import connect_option, credentials_option
from slowtime_cli.shared.outputs import out_option


@click.command(
    cls=Deferred,
    fixed={"timeout_s": 2.0},
    work="operation.doctor.report:doctor",
    epilog="""\b
Examples:
  slowtime doctor
  slowtime doctor --connect tcp/10.0.0.2:7447 --server https://twin.example.org
  slowtime doctor --mqtt 127.0.0.1:1883
  slowtime doctor --out doctor.json                for a report of an error
""",
)
@connect_option
@credentials_option
@click.option(
    "--server",
    default="http://127.0.0.1:8000",
    show_default=True,
    metavar="URL",
    help="Address of the twin server.",
)
@click.option("--mqtt", metavar="HOST[:PORT]", help="An MQTT broker to try as well.")
@click.option(
    "--folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=".",
    help="Folder in which databases and recordings are to be written.  [default: this one]",
)
@out_option("JSON file of the findings.")
def doctor(**_given: object) -> None:
    """Check installation, ports, router, clock and write access.

    Each line is `ok`, `note` (something optional is absent) or `problem`, with what to do.
    Nothing is changed, and nothing is sent except to the addresses given. The exit status is 1
    if there is a problem.
    """
