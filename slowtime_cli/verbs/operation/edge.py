"""Arguments and help of the verb `edge`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.demo_structures import STRUCTURES
from slowtime_cli.shared.flags import EXISTING, SettingsFile, unit_flags
from slowtime_cli.shared.help_pages import Rare
from slowtime_cli.shared.options import (
    POSITIVE,
    Name,
    Names,
    Real,
    connect_option,
    credentials_option,
    together,
)
from slowtime_cli.shared.settings import setting, settings_option


def _recording_apart(
    ctx: click.Context, _param: click.Parameter, path: Path | None
) -> Path | None:
    """Hand on a recording under a name of its own."""
    if path is None or path.suffix.lower() != ".mcap":
        return path
    ctx.params["recording"] = path
    return None


@click.command(
    cls=Deferred,
    fixed={"recording": None},
    work="operation.edge:edge",
    epilog="""\b
Examples:
  slowtime edge --simulate tower
  slowtime edge --simulate frame
  slowtime edge --site lab --asset beam --file record.csv --rate-hz 200 --window-s 60
  slowtime edge --site lab --asset beam --file raw.mcap --window-s 1 --hop-s 0.5
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
@click.option("--site", type=Name(), help="Site of the asset.  [default: demo]")
@click.option(
    "--asset",
    type=Name(),
    help="Name of the asset.  [default: tower, or the simulated structure]",
)
@click.option(
    "--simulate",
    type=click.Choice(sorted(STRUCTURES)),
    help="Read a simulated structure instead of a sensor.",
)
@click.option(
    "--file",
    "file",
    type=EXISTING,
    callback=_recording_apart,
    help="Read a record, or the raw blocks of an MCAP recording. Records are text, NumPy, "
    "MATLAB, Excel, TDMS, WAV, miniSEED, HDF5, UFF and others (docs/files.md).",
)
@click.option(
    "--source",
    metavar="URL",
    help="Read a live sensor: its address and, behind `?`, the layout of its messages.",
)
@click.option(
    "--rate-hz",
    type=POSITIVE,
    help="Sampling rate of --file or --source, if it does not state one.",
)
@unit_flags
@click.option(
    "--speed",
    type=Real(min=0),
    default=1.0,
    show_default=True,
    help="Pace of --file; 0 as fast as possible.",
    cls=Rare,
)
@click.option(
    "--channels", type=Names(), help="Channels to identify from: a,b.  [default: all]"
)
@click.option(
    "--method",
    type=click.Choice(["auto", "ambient", "free_decay", "peak", "modes", "recursive"]),
    help="How to identify the first mode, or all modes with shapes, window by window, or "
    "recursively from a continuous stream.  [default: auto, or what the simulated structure "
    "needs]",
)
@click.option(
    "--band-hz",
    nargs=2,
    type=Real(min=0),
    metavar="LO HI",
    help="Frequency band of the modes.",
)
@click.option("--window-s", type=POSITIVE, help="Window of a continuous stream.  [default: 60]")
@click.option(
    "--hop-s", type=POSITIVE, help="Distance between windows.  [default: the window]", cls=Rare
)
@connect_option
@credentials_option
@click.option(
    "--spool",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder where features wait for the twin.  [default: var/spool]",
    cls=Rare,
)
@settings_option(
    setting(
        "--password-file",
        type=EXISTING,
        help="File that holds the password of the user in the URL of --source.",
    ),
    setting(
        "--epochs-per-s",
        type=POSITIVE,
        help="Pace of --simulate.  [default: 5, or 1 for a frame]",
    ),
    setting("--raw/--no-raw", default=None, help="Publish raw blocks too, for recording."),
)
@click.option(
    "--link",
    type=click.Choice(["lab", "field", "metered"]),
    help="What the link may cost: the interval of heartbeats and features, and keep-alives "
    "(docs/edge.md).  [default: lab]",
)
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

    Without a router it keeps working and stores its features on disk until one is available.
    """
    together(
        [
            ("--simulate", simulate),
            ("--file", file or recording),
            ("--source", source),
        ]
    )
    if rate_hz is not None and file is None and source is None:
        raise click.UsageError(
            "--rate-hz goes with --file or --source; other inputs state their own rate."
        )
    if (units or sensitivities) and not (file or recording or source):
        raise click.UsageError(
            "--unit and the sensitivity of --reading go with --file or --source."
        )
    if password_file is not None and source is None:
        raise click.UsageError("The setting password_file goes with --source.")
    if not (simulate or file or recording or source or config):
        raise click.UsageError(
            "An edge agent needs an input. Give --source, --simulate, --file, or "
            "a --config that names one."
        )
