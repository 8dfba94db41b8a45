"""Arguments and help of the verb `twin outputs`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import SettingsFile


@click.command(
    cls=Deferred,
    work="operation.outputs:outputs",
    epilog="""\b
Examples:
  slowtime twin outputs outputs.toml
\b
  # outputs.toml
  server = "http://127.0.0.1:8000"
  [outputs.database]
  kind = "influx"                       # or mqtt, sparkplug, opcua
  url = "http://127.0.0.1:8086"
  database = "plant"

Every setting can also be given as SLOWTIME_OUTPUTS_NAME (nested with two underscores), and the
token of the server in SLOWTIME_TOKEN. docs/outputs.md describes all settings.
""",
)
@click.argument("settings", type=SettingsFile())
def outputs(**_given: object) -> None:
    """Send states and events of a server to MQTT, InfluxDB and OPC UA.

    SETTINGS is a TOML or JSON file that names the twin server and the receivers. It runs until
    it is stopped; what a receiver missed is sent when it is back.
    """
