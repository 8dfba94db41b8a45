"""Verbs that are processes of the house, `edge`, `twin`, `router`, and `status`."""

import contextlib
import json
import logging
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import click

from edge_agent.settings import EdgeSettings
from slowtime_schemas.streams import alive_key
from slowtime_services import router as router_process
from slowtime_services.bus import Bus, BusUnreachableError, ZenohBus
from slowtime_services.credentials import options_for

from .options import (
    POSITIVE,
    ROUTER,
    Database,
    Endpoint,
    Name,
    Number,
    connect_option,
    credentials_option,
    endpoints,
    names,
    together,
)
from .structures import EPOCHS_PER_S, METHODS, STRUCTURES, structure

CONFIG = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command(
    epilog="""\b
Examples:
  slowtime edge --simulate tower
  slowtime edge --simulate frame
  slowtime edge --site lab --asset beam --file record.csv --rate-hz 200 --window-s 60
  slowtime edge --site lab --asset beam --recording raw.mcap --window-s 1 --hop-s 0.5
  SLOWTIME_EDGE_SITE=lab slowtime edge --config edge.toml

Every setting can be given in a TOML or JSON file or as SLOWTIME_EDGE_NAME (nested with two
underscores); flags overrule the environment, which overrules the file.
"""
)
@click.option("--config", type=CONFIG, help="TOML or JSON file of settings.")
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
@click.option("--file", "file", type=CONFIG, help="Listen to a text, NumPy or MATLAB record.")
@click.option("--recording", type=CONFIG, help="Listen to the raw blocks of an MCAP recording.")
@click.option(
    "--rate-hz", type=POSITIVE, help="Samples per second of --file, where it does not say."
)
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
    type=click.Choice(["auto", "ambient", "free_decay", "peak", "modes"]),
    help="How to identify the first mode, or all modes with shapes.  [default: auto, or what "
    "the simulated structure needs]",
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
    site: str | None,
    asset: str | None,
    simulate: str | None,
    file: Path | None,
    recording: Path | None,
    rate_hz: float | None,
    speed: float,
    epochs_per_s: float | None,
    channels: str | None,
    method: Literal["auto", "ambient", "free_decay", "peak", "modes"] | None,
    band_hz: tuple[float, float] | None,
    window_s: float | None,
    hop_s: float | None,
    raw: bool | None,
    spool: Path | None,
    connect: tuple[str, ...],
    credentials: Path | None,
) -> int:
    """Run an edge agent: samples in, features with uncertainty out.

    Without a router it goes on, and keeps its features on disk until there is one.
    """
    from edge_agent.__main__ import run

    together([("--simulate", simulate), ("--file", file), ("--recording", recording)])
    if rate_hz is not None and file is None:
        raise click.UsageError("--rate-hz goes with --file; other inputs say their rate.")
    source: dict[str, Any] = {}
    if simulate:
        source = {
            "kind": "simulated",
            "structure": structure(simulate),
            "every_s": 1 / (epochs_per_s or EPOCHS_PER_S[simulate]),
        }
    elif file:
        source = {"kind": "file", "path": file, "rate_hz": rate_hz, "speed": speed}
    elif recording:
        source = {"kind": "recording", "path": recording, "speed": speed}
    elif config is None:
        raise click.UsageError(
            "An edge agent needs an input. Give --simulate, --file, --recording, or a --config "
            "that names one."
        )
    extract = _given(
        channels=names(channels, "--channels"),
        band_hz=band_hz or None,
        method=method or (METHODS[simulate] if simulate else None),
        window_s=window_s,
        hop_s=hop_s,
    )
    with _naming(config):
        settings = EdgeSettings(
            **_given(
                config=config,
                site=site,
                asset=asset or simulate,
                connect=_endpoints(connect, config, credentials),
                credentials=credentials,
                input=source or None,
                extract=extract or None,
                publish={"raw": "on" if raw else "off"} if raw is not None else None,
                spool={"folder": spool} if spool else None,
            )
        )
    return run(settings)


@click.command(
    epilog="""\b
Examples:
  slowtime twin
  slowtime twin --port 8080 --database /var/lib/slowtime/twin.sqlite
  slowtime twin --host 0.0.0.0 --tokens tokens.json --tls-certificate c.pem --tls-key k.pem
  curl -X PUT http://127.0.0.1:8000/api/v1/twins/lab.beam -H 'Content-Type: application/json' \\
    -d '{"changes": "stiffness", "nominal": {"frequency_hz": 26.3, "damping_ratio": 0.01}}'

Every setting can be given in a TOML or JSON file or as SLOWTIME_TWIN_NAME (nested with two
underscores); flags overrule the environment, which overrules the file.
"""
)
@click.option("--config", type=CONFIG, help="TOML or JSON file of settings.")
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
    type=CONFIG,
    help="TOML or JSON file: twin id → registration, for twins not yet registered.",
)
@click.option(
    "--tokens",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File made by `slowtime tokens`: who may ask REST and page.",
)
@click.option("--tls-certificate", type=CONFIG, help="Certificate of REST and page (PEM).")
@click.option("--tls-key", type=CONFIG, help="Its private key (PEM).")
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
def twin(
    config: Path | None,
    host: str | None,
    port: int | None,
    database: Path | str | None,
    recordings: Path | None,
    registrations: Path | None,
    tokens: Path | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    behind_proxy: bool,
    published_on_loopback: bool,
    connect: tuple[str, ...],
    credentials: Path | None,
) -> int:
    """Run the twin server: features in; knowledge, REST and page out.

    Knowledge is the history of stiffness and mass, its forecast, and alarms. Beyond 127.0.0.1
    it listens only with encryption, or a proxy that does it, and with tokens.
    """
    from twin_server.__main__ import run
    from twin_server.registration import registrations as read_registrations
    from twin_server.settings import TwinSettings

    if (tls_certificate is None) != (tls_key is None):
        raise click.UsageError("--tls-certificate and --tls-key go together. Give both.")
    access = _given(
        tokens=tokens,
        behind_proxy=behind_proxy or None,
        published_on_loopback=published_on_loopback or None,
    )
    with _naming(config):
        settings = TwinSettings(
            **_given(
                config=config,
                host=host,
                port=port,
                database=database,
                registrations=registrations,
                diagnose={"recordings": recordings} if recordings else None,
                connect=_endpoints(connect, config, credentials),
                credentials=credentials,
                access=access or None,
                tls={"certificate": tls_certificate, "key": tls_key} if tls_key else None,
            )
        )
    read_registrations(settings.registrations)  # refused before a router is waited for
    return run(settings)


@click.command(
    epilog="""\b
Examples:
  slowtime router
  slowtime router --credentials keys/router --listen tls/0.0.0.0:7447
  slowtime router --listen tcp/127.0.0.1:7448 --connect tcp/10.0.0.2:7447
"""
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
def router(
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    credentials: Path | None,
    insecure: bool,
) -> None:
    """Run a Zenoh router: what edges, twin and recorder connect to.

    With credentials it lets in who holds a certificate of its site, and lets each do what its
    certificate is for. Without, it listens to this machine only.
    """
    router_process.run(
        endpoints(listen, credentials),
        connect,
        credentials=credentials,
        insecure=insecure,
        ready=lambda where: click.echo(f"Router on {', '.join(where)}"),
    )


@click.command(
    epilog="""\b
Examples:
  slowtime status
  slowtime status --asset demo.tower && echo "the tower is listened to"
"""
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
def status(
    connect: tuple[str, ...], credentials: Path | None, asset: str | None, timeout_s: float
) -> int:
    """Tell whether the router answers and which edge agents live.

    Leaves with 0 if all that was asked for is there, else with 1; made for health checks.
    """
    logging.getLogger("slowtime_services").setLevel(logging.CRITICAL)
    site, _, name = (asset or "*.*").partition(".")
    connect = endpoints(connect, credentials)
    options = options_for(credentials, connect)
    try:
        with ZenohBus("client", connect, open_timeout_s=timeout_s, options=options) as bus:
            alive = _alive(bus, alive_key(site, name), timeout_s if asset else 0.5)
    except BusUnreachableError as error:
        click.echo(str(error), err=True)
        return 1
    for key in sorted(alive):
        click.echo("{}.{} is alive".format(*key.split("/")[2:4]))
    if not alive:
        click.echo(
            f"{asset or 'No edge agent'} is {'not ' if asset else ''}alive; the router answers."
        )
    return 0 if alive or asset is None else 1


def _alive(bus: Bus, key: str, timeout_s: float) -> set[str]:
    """Keys of who is alive: the first to be heard of, or all within `timeout_s`."""
    seen: set[str] = set()
    heard = threading.Event()

    def change(who: str, alive: bool) -> None:
        (seen.add if alive else seen.discard)(who)
        if who == key:
            heard.set()

    watching = bus.watch(key, change)
    heard.wait(timeout_s)
    watching.close()
    return seen


def _given(**settings: Any) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}


@contextlib.contextmanager
def _naming(config: Path | None) -> Iterator[None]:
    """Say which file it was that could not be read."""
    try:
        yield
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        kind = "JSON" if config is not None and config.suffix == ".json" else "TOML"
        raise click.UsageError(f"--config {config} is not {kind}: {error}.") from error


def _endpoints(
    connect: tuple[str, ...], config: Path | None, credentials: Path | None
) -> tuple[str, ...] | None:
    """Leave the endpoint to the file, where there is one and the flag was not used."""
    left = config is not None and connect == (ROUTER,)
    return None if left else endpoints(connect, credentials)
