"""Arguments and help of the verb `identify`."""

from pathlib import Path

import click

from slowtime.identification.options import ALL_CHANNELS, WITH_POLES, IdentifyOptions
from slowtime_cli.shared.declared import options_of
from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, record_flags
from slowtime_cli.shared.help_pages import Rare
from slowtime_cli.shared.options import POSITIVE, Names, OutFile
from slowtime_cli.shared.report_flags import wording
from slowtime_cli.shared.settings import setting, settings_option

UNIVERSAL = (".uff", ".unv")
"""As `slowtime_services.modal.UNIVERSAL`, without reading modes yet."""


@click.command(
    cls=Deferred,
    work="records.identify_stream:identify",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime identify record.csv --rate-hz 200
  slowtime identify record.csv --rate-hz 200 --band-hz 1 20 --out modes.json
  slowtime identify tower.mcap --window-s 60 --hop-s 60 --out modes.json
  slowtime identify record.csv --rate-hz 200 --out - | python -m json.tool
  slowtime identify record.csv --rate-hz 200 --method modes --report modes.html
  slowtime identify record.tdms --reading sensitivity=100mV/g --out modes.uff
  slowtime identify hits.npz --input force --setting driving_point=a3=force --frf h.uff
  slowtime identify responses.csv --setting frf_kind=acceleration --band-hz 5 200
  slowtime identify record.csv --rate-hz 200 --select modes.selection.yaml
  slowtime identify deck.mcap --with tower.mcap --method modes --out modes.json

A terminal is shown a table; a pipe or a file gets lines with tabs between their fields.
""",
)
@record_flags
@options_of(IdentifyOptions)
@click.option(
    "--window-s", type=POSITIVE, help="Identify window by window instead of the whole record."
)
@click.option(
    "--hop-s",
    type=POSITIVE,
    help="From one window to the next; shorter than a window, they overlap and are marked.  "
    "[default: a whole window]",
    cls=Rare,
)
@click.option(
    "--stream/--whole",
    default=None,
    help="Whether the record is read as a stream, with recursive identification and limited "
    "memory, or all at once.  [default: a stream from 256 MiB on]",
    cls=Rare,
)
@click.option(
    "--with",
    "second",
    type=EXISTING,
    metavar="RECORD",
    help="A second board's record of the same structure. Both are synchronised by modes that "
    "both measure, or refused with the reason. It is read with the same options as "
    "RECORD.",
    cls=Rare,
)
@click.option(
    "--input",
    "inputs",
    type=Names(),
    help="Measured inputs: force of a hammer or of shakers, or motion of the base: f,g. The "
    "other channels are responses.",
)
@click.option(
    "--frf",
    type=OutFile(),
    help="With --input: file of frequency responses to write: .uff or .unv (UFF 58), .csv, "
    "else JSON with the fit and modal masses.",
    cls=Rare,
)
@click.option(
    "--model",
    type=EXISTING,
    help="Model file (YAML or JSON, finite elements too) to compare the modes with, mode by "
    "mode; or modes of another program, as a universal file (.uff, .unv).",
)
@click.option(
    "--report",
    type=OutFile(".html", ".pdf"),
    help="Report to write, .html or .pdf. Answer and confidence on its first page; table, "
    "spectra, stabilisation diagram over the spectrum, shapes and their MAC; in space with "
    "--geometry or a --model in space. Beside it, a file for --select.",
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="File to write: .uff or .unv (UFF 55), .csv, else JSON; - for JSON on stdout instead "
    "of the table.",
)
@click.option(
    "--geometry",
    type=EXISTING,
    help="Where the channels are, for --out .uff and --report. CSV with channel, x, y, z, "
    "direction, or a universal file with nodes.",
)
@settings_option(
    setting(
        "--driving-point",
        "driving_points",
        multiple=True,
        metavar="RESPONSE=INPUT",
        help="With --input: a response measured where that input acts, for modal masses.",
    ),
    setting(
        "--start-sd-ms",
        type=POSITIVE,
        default=20.0,
        show_default=True,
        help="With --with: how well the start of each record is known (one standard "
        "deviation).",
    ),
    setting(
        "--rate-sd-ppm",
        type=POSITIVE,
        default=100.0,
        show_default=True,
        help="With --with: how well the rate of each record is known (one standard deviation).",
    ),
    setting(
        "--excitation",
        type=click.Choice(["auto", "hammer", "shaker", "base"]),
        default="auto",
        show_default=True,
        help="With --input: what excites the structure; auto detects it from unit and signal.",
    ),
    setting(
        "--estimator",
        type=click.Choice(["h1", "h2", "hv"]),
        default="h1",
        show_default=True,
        help="With --input: noise in responses (h1), in the input (h2) or in both (hv).",
    ),
    setting(
        "--block-s",
        type=POSITIVE,
        help="With a hammer: length of a block.  [default: from a blow to the next]",
    ),
    setting(
        "--decay-s",
        type=POSITIVE,
        help="With a hammer: time constant of an exponential window, whose added damping is "
        "removed.  [default: none; modes are fitted to the record without a window]",
    ),
    setting(
        "--frf-kind",
        type=click.Choice(["displacement", "velocity", "acceleration", "transmissibility"]),
        help="RECORD holds measured frequency responses of this quantity per force (or of a "
        "motion per motion of the base).  [default: detected]",
    ),
    *wording(),
)
def identify(
    window_s: float | None,
    hop_s: float | None,
    gaps: str,
    method: str,
    model: Path | None,
    select: Path | None,
    report: Path | None,
    out: Path | None,
    geometry: Path | None,
    stream: bool | None,
    second: Path | None,
    inputs: tuple[str, ...] | None,
    driving_points: tuple[str, ...],
    block_s: float | None,
    decay_s: float | None,
    frf: Path | None,
    **_given: object,
) -> None:
    """Identify natural frequencies and damping, with uncertainty.

    RECORD is text of any delimiter, NumPy, MATLAB, Excel, TDMS, WAV, miniSEED, HDF5, Parquet,
    UFF, MCAP and others (docs/files.md). Frequencies are undamped natural
    frequencies; errors are standard deviations. If no mode exceeds the noise, none is
    reported.
    """
    if inputs is None and (block_s or decay_s):
        raise click.UsageError(
            "The settings block_s and decay_s can only be used together with --input, which "
            "names the measured inputs. Give --input, or leave them out."
        )
    if inputs is not None:
        if window_s or stream or second or method != "auto" or gaps != "use":
            raise click.UsageError(
                "--input has a method of its own, for one whole record. Leave out --window-s, "
                "--stream, --with, --gaps and --method."
            )
        return
    if hop_s is not None and window_s is None:
        raise click.UsageError("--hop-s goes with --window-s.")
    universal = out is not None and out.suffix.lower() in UNIVERSAL
    if geometry is not None and not (universal or report):
        raise click.UsageError("--geometry goes with --out .uff or .unv, or with --report.")
    if universal and (window_s is not None or method not in ("auto", *ALL_CHANNELS)):
        raise click.UsageError(
            f"A universal file holds modes with shapes, of a whole record. Give --method "
            f"{', '.join(ALL_CHANNELS)} without --window-s, or write .json or .csv."
        )
    if window_s is not None and (method in ALL_CHANNELS or model or report or select):
        raise click.UsageError(
            f"--window-s follows the first mode. Leave it out for --method "
            f"{', '.join(ALL_CHANNELS)}, --model, --select and --report."
        )
    one_of_a_stream = method in ("auto", "modes") and gaps == "use"
    if stream and (window_s or report or select or second or not one_of_a_stream):
        raise click.UsageError(
            "--stream finds all modes of a record of any length, and uses all samples. Leave "
            "out --window-s, --report, --select, --with, --gaps and any --method but modes, or "
            "give --whole."
        )
    if select and method not in ("auto", *WITH_POLES):
        raise click.UsageError(
            f"--select chooses among poles, which --method {method} has none of. Give "
            "--method modes or bayes."
        )
    if (model or report) and method not in ("auto", *ALL_CHANNELS):
        raise click.UsageError(
            f"--model and --report go with --method {', '.join(ALL_CHANNELS)}."
        )
