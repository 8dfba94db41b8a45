"""Verbs that are processes of the house, `edge`, `twin`, `router`, and `status`."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import (
    POSITIVE,
    ROUTER,
    Database,
    Endpoint,
    Name,
    Number,
    connect_option,
    credentials_option,
    together,
)
from slowtime_cli.structures import STRUCTURES

from .flags import EXISTING, SettingsFile, unit_flags


@click.command(
    cls=Deferred,
    work="processes:edge",
    epilog="""\b
Examples:
  slowtime edge --simulate tower
  slowtime edge --simulate frame
  slowtime edge --site lab --asset beam --file record.csv --rate-hz 200 --window-s 60
  slowtime edge --site lab --asset beam --recording raw.mcap --window-s 1 --hop-s 0.5
  slowtime edge --asset beam --source 'mqtt://pi@10.0.0.2/beam?channels=x,y,z&rate_hz=200'
  my-program | slowtime edge --source 'stdin:?layout=csv&channels=x,y,z&rate_hz=200'
  slowtime edge --asset beam --file record.csv --unit mg --unit deck=mm/s --method modes

Schemes of --source: mqtt, mqtts, tcp, tcp-listen, udp, serial, stdin, zenoh, iio, opcua;
docs/live.md tells what each takes.
  SLOWTIME_EDGE_SITE=lab slowtime edge --config edge.toml

Every setting can be given in a TOML or JSON file or as SLOWTIME_EDGE_NAME (nested with two
underscores); flags overrule the environment, which overrules the file.
""",
)
@click.option("--config", type=SettingsFile(), help="TOML or JSON file of settings.")
@click.option("--site", type=Name(), help="Where the asset stands.  [default: demo]")
@click.option(
    "--asset",
    type=Name(),
    help="Name of the asset.  [default: tower, or the simulated structure]",
)
@click.option(
    "--simulate",
    type=click.Choice(sorted(STRUCTURES)),
    help="Listen to a simulated structure instead of a sensor.",
)
@click.option("--file", "file", type=EXISTING, help="Listen to a text, NumPy or MATLAB record.")
@click.option(
    "--recording", type=EXISTING, help="Listen to the raw blocks of an MCAP recording."
)
@click.option(
    "--source",
    metavar="URL",
    help="Listen to a live sensor: where it is and, behind `?`, what its messages hold.",
)
@click.option(
    "--password-file",
    type=EXISTING,
    help="File that holds the password of the user in the URL of --source.",
)
@click.option(
    "--rate-hz",
    type=POSITIVE,
    help="Samples per second of --file or --source, where it does not say.",
)
@unit_flags
@click.option(
    "--speed",
    type=Number(min=0),
    default=1.0,
    show_default=True,
    help="Pace of --file or --recording; 0 as fast as possible.",
)
@click.option(
    "--epochs-per-s",
    type=POSITIVE,
    help="Pace of --simulate.  [default: 5, or 1 for a frame]",
)
@click.option("--channels", help="Channels to identify from: a,b.  [default: all]")
@click.option(
    "--method",
    type=click.Choice(["auto", "ambient", "free_decay", "peak", "modes", "recursive"]),
    help="How to identify the first mode, or all modes with shapes, window by window or, "
    "recursive, of a stream that never ends.  [default: auto, or what the simulated structure "
    "needs]",
)
@click.option(
    "--band-hz",
    nargs=2,
    type=Number(min=0),
    metavar="LO HI",
    help="Where to look for modes.",
)
@click.option("--window-s", type=POSITIVE, help="Window of a continuous stream.  [default: 60]")
@click.option(
    "--hop-s", type=POSITIVE, help="From one window to the next.  [default: the window]"
)
@click.option("--raw/--no-raw", default=None, help="Publish raw blocks too, for recording.")
@click.option(
    "--spool",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder where features wait for the twin.  [default: var/spool]",
)
@connect_option
@credentials_option
def edge(
    config: Path | None,
    simulate: str | None,
    file: Path | None,
    recording: Path | None,
    source: str | None,
    password_file: Path | None,
    rate_hz: float | None,
    units: tuple[str, ...],
    sensitivities: tuple[str, ...],
    **_given: object,
) -> None:
    """Run an edge agent: samples in, features with uncertainty out.

    Without a router it goes on, and keeps its features on disk until there is one.
    """
    together(
        [
            ("--simulate", simulate),
            ("--file", file),
            ("--recording", recording),
            ("--source", source),
        ]
    )
    if rate_hz is not None and file is None and source is None:
        raise click.UsageError(
            "--rate-hz goes with --file or --source; other inputs say their rate."
        )
    if (units or sensitivities) and not (file or recording or source):
        raise click.UsageError(
            "--unit and --sensitivity go with --file, --recording or --source."
        )
    if password_file is not None and source is None:
        raise click.UsageError("--password-file goes with --source.")
    if not (simulate or file or recording or source or config):
        raise click.UsageError(
            "An edge agent needs an input. Give --source, --simulate, --file, --recording, or "
            "a --config that names one."
        )


@click.command(
    cls=Deferred,
    work="processes:twin",
    extra="twin",
    epilog="""\b
Examples:
  slowtime twin
  slowtime twin --port 8080 --database /var/lib/slowtime/twin.sqlite
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
    help="Folder of recordings (MCAP) that the page takes, gives and plays.",
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
    help="File made by `slowtime tokens`: who may ask REST and page.",
)
@click.option(
    "--ledger-key",
    type=EXISTING,
    help="Key of `slowtime ledger key`: what is accepted is signed with it.",
)
@click.option("--tls-certificate", type=EXISTING, help="Certificate of REST and page (PEM).")
@click.option("--tls-key", type=EXISTING, help="Its private key (PEM).")
@click.option(
    "--behind-proxy",
    is_flag=True,
    help="A proxy before this server does the encryption.",
)
@click.option(
    "--published-on-loopback",
    is_flag=True,
    help="Who reaches the port is on this machine, as where a container's port is published "
    "on 127.0.0.1 alone.",
)
@connect_option
@credentials_option
def twin(tls_certificate: Path | None, tls_key: Path | None, **_given: object) -> None:
    """Run the twin server: features in; knowledge, REST and page out.

    Knowledge is the history of stiffness and mass, its forecast, and alarms. Beyond 127.0.0.1
    it listens only with encryption, or a proxy that does it, and with tokens.
    """
    if (tls_certificate is None) != (tls_key is None):
        raise click.UsageError("--tls-certificate and --tls-key go together. Give both.")


@click.command(
    cls=Deferred,
    work="routing:router",
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
    help="Endpoint to listen on; may be given several times.",
)
@click.option("--connect", multiple=True, type=Endpoint(), help="Another router to join.")
@credentials_option
@click.option(
    "--insecure",
    is_flag=True,
    help="Let anybody who reaches the endpoint read and write everything.",
)
def router(**_given: object) -> None:
    """Run a Zenoh router: what edges, twin and recorder connect to.

    With credentials it lets in who holds a certificate of its site, and lets each do what its
    certificate is for. Without, it listens to this machine only.
    """


@click.command(
    cls=Deferred,
    work="routing:status",
    epilog="""\b
Examples:
  slowtime status
  slowtime status --asset demo.tower && echo "the tower is listened to"
""",
)
@connect_option
@credentials_option
@click.option("--asset", type=Name(parts=2), help="SITE.ASSET that must be alive.")
@click.option(
    "--timeout-s",
    default=4.0,
    show_default=True,
    type=Number(min=0.1),
    help="How long to wait.",
)
def status(**_given: object) -> None:
    """Tell whether the router answers and which edge agents live.

    Leaves with 0 if all that was asked for is there, else with 1; made for health checks.
    """
