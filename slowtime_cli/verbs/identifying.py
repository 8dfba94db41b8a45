"""The verb `identify`: somebody's samples in, natural frequencies and damping out."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.methods import ALL_CHANNELS
from slowtime_cli.options import POSITIVE, Number, OutFile

from .flags import EXISTING, record_flags


@click.command(
    cls=Deferred,
    work="identifying:identify",
    epilog="""\b
Examples:
  slowtime identify record.csv --rate-hz 200
  slowtime identify record.csv --rate-hz 200 --band-hz 1 20 --out modes.json
  slowtime identify tower.mcap --window-s 60 --hop-s 60 --out modes.json
  slowtime identify record.csv --rate-hz 200 --out - | python -m json.tool
  slowtime identify record.csv --rate-hz 200 --method modes --report modes.html
  slowtime identify deck.mcap --with tower.mcap --method modes --out modes.json

A terminal is shown a table; a pipe or a file gets lines with tabs between their fields.
""",
)
@record_flags
@click.option(
    "--band-hz",
    nargs=2,
    type=Number(),
    metavar="LO HI",
    help="Where to look for modes.  [default: from a few cycles to 0.45 of the rate]",
)
@click.option(
    "--window-s", type=POSITIVE, help="Identify window by window instead of the whole record."
)
@click.option(
    "--hop-s",
    type=POSITIVE,
    help="From one window to the next; shorter than a window, they overlap and are marked.  "
    "[default: a whole window]",
)
@click.option(
    "--method",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", *ALL_CHANNELS, "ambient", "free_decay", "peak"]),
    help="How to fit; auto finds out what the record is. modes: every mode of all channels "
    "together, with shapes; lines of machines are told apart. bayes: these modes by the "
    "fast Bayesian FFT. efdd, fdd: frequency domain decomposition, with and without damping.",
)
@click.option(
    "--with",
    "second",
    type=EXISTING,
    metavar="RECORD",
    help="A second board's record of the same structure: both are put on one clock by modes "
    "that both see, or refused with the reason. It is read as RECORD is.",
)
@click.option(
    "--start-sd-ms",
    type=POSITIVE,
    default=20.0,
    show_default=True,
    help="With --with: how well the start of each record is known (one standard deviation).",
)
@click.option(
    "--rate-sd-ppm",
    type=POSITIVE,
    default=100.0,
    show_default=True,
    help="With --with: how well the rate of each record is known (one standard deviation).",
)
@click.option(
    "--model",
    type=EXISTING,
    help="Model file (YAML) to compare the modes with, mode by mode.",
)
@click.option(
    "--report",
    type=OutFile(".html"),
    help="HTML page to write: table, spectra, stabilisation diagram, shapes.",
)
@click.option(
    "--out", type=OutFile(stdout=True), help="JSON file to write; - for stdout, and no table."
)
def identify(
    window_s: float | None,
    hop_s: float | None,
    method: str,
    model: Path | None,
    report: Path | None,
    **_given: object,
) -> None:
    """Find natural frequencies and damping in a record, with errors.

    RECORD is MCAP, text of any delimiter, NumPy or MATLAB. Frequencies are undamped natural
    frequencies; errors are standard deviations. Where nothing stands out of the noise, nothing
    is claimed.
    """
    if hop_s is not None and window_s is None:
        raise click.UsageError("--hop-s goes with --window-s.")
    if window_s is not None and (method in ALL_CHANNELS or model or report):
        raise click.UsageError(
            f"--window-s follows the first mode. Leave it out for --method "
            f"{', '.join(ALL_CHANNELS)}, --model and --report."
        )
    if (model or report) and method not in ("auto", *ALL_CHANNELS):
        raise click.UsageError(
            f"--model and --report go with --method {', '.join(ALL_CHANNELS)}."
        )
