"""Arguments and help of the verb `twin`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, SettingsFile
from slowtime_cli.shared.help_pages import Rare
from slowtime_cli.shared.options import Database, connect_option, credentials_option


@click.command(
    cls=Deferred,
    work="operation.twin:twin",
    extra="twin",
    epilog="""\b
Examples:
  slowtime twin
  slowtime twin --port 8080 --database /var/lib/slowtime/twin.sqlite
  slowtime twin --shards 4
  slowtime twin --host 0.0.0.0 --tokens tokens.json --tls-certificate c.pem --tls-key k.pem
  curl -X PUT http://127.0.0.1:8000/api/v1/twins/lab.beam -H 'Content-Type: application/json' \\
    -d '{"changes": "stiffness", "nominal": {"frequency_hz": 26.3, "damping_ratio": 0.01}}'

Every setting can be given in a TOML or JSON file or as SLOWTIME_TWIN_NAME (nested with two
underscores); flags overrule the environment, which overrules the file.
""",
)
@click.option("--config", type=SettingsFile(), help="TOML or JSON file of settings.")
@click.option("--host", help="Address to listen on.  [default: 127.0.0.1]")
@click.option(
    "--port", type=click.IntRange(0, 65535), help="Port of REST and page.  [default: 8000]"
)
@click.option(
    "--database",
    type=Database(),
    help="SQLite file of the history, or postgresql://user@host/name.  [default: twin.sqlite]",
)
@click.option(
    "--recordings",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of recordings (MCAP) for upload, download and replay by the page.",
    cls=Rare,
)
@click.option(
    "--register",
    "registrations",
    type=EXISTING,
    help="TOML or JSON file: twin id → registration, for twins not yet registered.",
)
@click.option(
    "--tokens",
    type=EXISTING,
    help="File made by `slowtime tokens`: access to REST and page.",
)
@click.option(
    "--ledger-key",
    type=EXISTING,
    help="Key of `slowtime db ledger key`, which signs accepted rows.",
    cls=Rare,
)
@click.option(
    "--tls-certificate", type=EXISTING, help="Certificate of REST and page (PEM).", cls=Rare
)
@click.option("--tls-key", type=EXISTING, help="Its private key (PEM).", cls=Rare)
@click.option(
    "--behind-proxy", is_flag=True, help="A proxy in front of this server encrypts.", cls=Rare
)
@click.option(
    "--shards",
    type=click.IntRange(1, 256),
    help="Divide the assets among so many processes, each with a database of its own.  "
    "[default: 1]",
    cls=Rare,
)
@connect_option
@credentials_option
@click.option(
    "--engine",
    cls=Rare,
    metavar="local|ray[://HOST:PORT]",
    help="Who runs the shards: this machine, or a Ray cluster, which starts them again on "
    "another node if one is lost (needs slowtime[ray]; see docs/shards.md).  [default: "
    "local]",
)
@click.option(
    "--published-on-loopback",
    cls=Rare,
    is_flag=True,
    help="Only this computer reaches the port, for instance a container's port published "
    "on 127.0.0.1 only.",
)
def twin(tls_certificate: Path | None, tls_key: Path | None, **_given: object) -> None:
    """Run the twin server: features in; estimates, REST and page out.

    It keeps the history of stiffness and mass, forecasts it, and raises alarms. Beyond
    127.0.0.1 it listens only with tokens, and with encryption or a proxy that encrypts.
    """
    if (tls_certificate is None) != (tls_key is None):
        raise click.UsageError("--tls-certificate and --tls-key go together. Give both.")
