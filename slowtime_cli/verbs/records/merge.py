"""Arguments and help of the verb `merge`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, Names, OutFile


@click.command(
    cls=Deferred,
    work="records.merge:merge_setups",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime identify low.csv --rate-hz 100 --method modes --out low.json
  slowtime identify high.csv --rate-hz 100 --method modes --out high.json
  slowtime modes merge low.json high.json --out whole.json
  slowtime modes merge low.json high.json --references top --out whole.unv
  slowtime modes merge low.csv high.csv --before --rate-hz 100 --band-hz 0.5 20 --out whole.json

Channels of one name are one place and direction on the structure.
""",
)
@click.argument("files", type=EXISTING, nargs=-1, required=True)
@click.option(
    "--references",
    type=Names(),
    help="Reference channels, which stayed in place; by default those that all files have.",
)
@click.option(
    "--before",
    is_flag=True,
    help="FILES are records, identified together (PreGER); for set-ups between which the "
    "excitation has changed but the structure has not.",
)
@click.option(
    "--rate-hz",
    type=POSITIVE,
    help="With --before: sampling rate, if the files do not state one.",
)
@click.option(
    "--band-hz",
    nargs=2,
    type=POSITIVE,
    metavar="LO HI",
    help="With --before: frequency band of the modes.",
)
@click.option(
    "--out", type=OutFile(), help="File to write: .json, .csv, or .unv for a universal file."
)
def merge(
    files: tuple[Path, ...],
    before: bool,
    rate_hz: float | None,
    band_hz: tuple[float, float] | None,
    **_given: object,
) -> None:
    """Merge modes measured with several sensor set-ups.

    A few sensors stay in place as references while the others rove from set-up to set-up. FILES
    are the modes files of the set-ups, written by `slowtime identify RECORD --method modes
    --out`, or records with --before. Frequencies and damping ratios are means weighted by
    inverse variance; shapes are scaled to each other at the references by least squares. Where
    set-ups disagree, the standard deviations are enlarged and the mode carries a flag in the
    table and in the output file.
    """
    if len(files) < 2:
        raise click.UsageError(
            "There is only one set-up, so nothing can be merged. Give at least two files."
        )
    if before and band_hz is None:
        raise click.UsageError("--before needs --band-hz, the band of the modes.")
    if not before and (rate_hz is not None or band_hz is not None):
        raise click.UsageError(
            "--rate-hz and --band-hz go with --before, which merges records. Modes files are "
            "merged as they are."
        )
