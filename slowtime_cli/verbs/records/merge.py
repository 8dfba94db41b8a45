"""Arguments and help of the verb `merge`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Names, OutFile


@click.command(
    cls=Deferred,
    work="records.merge:merge_setups",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime identify low.csv --rate-hz 100 --method modes --out low.json
  slowtime identify high.csv --rate-hz 100 --method modes --out high.json
  slowtime merge low.json high.json --out whole.json
  slowtime merge low.json high.json --references top --out whole.unv

Channels of one name are one place and direction on the structure.
""",
)
@click.argument("files", type=EXISTING, nargs=-1, required=True)
@click.option(
    "--references",
    type=Names(),
    help="Channels that stayed in place; by default those that all files have.",
)
@click.option(
    "--out", type=OutFile(), help="File to write: .json, .csv, or .unv for a universal file."
)
def merge(files: tuple[Path, ...], **_given: object) -> None:
    """Merge the modes of several set-ups of sensors.

    A few sensors stay as references while the others are moved about. Frequencies and damping
    ratios are weighted means; shapes are scaled to each other over the references by least
    squares. Where set-ups disagree, the standard deviations grow and a flag says so.
    """
    if len(files) < 2:
        raise click.UsageError("One set-up is whole already. Give two files at least.")
