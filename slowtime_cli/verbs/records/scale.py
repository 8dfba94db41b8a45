"""Arguments and help of the verb `scale`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.outputs import out_option


@click.command(
    cls=Deferred,
    work="records.scale:scale",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime identify bare.csv --rate-hz 100 --method modes --out bare.json
  slowtime identify heavier.csv --rate-hz 100 --method modes --out heavier.json
  slowtime modes scale bare.json --added heavier.json a3=20,a4=20 --out scaled.json

A mass moves in every direction: where a place has several channels, name each of them.
""",
)
@click.argument("modes", type=EXISTING)
@click.option(
    "--added",
    type=(EXISTING, str),
    multiple=True,
    required=True,
    metavar="FILE CHANNEL=KG,...",
    help="Modes of the structure with masses added, and the mass at each channel [kg]; may be "
    "repeated for other masses.",
)
@out_option("JSON file to write, with scaled shapes.", ".json", to="out")
def scale(modes: Path, added: tuple[tuple[Path, str], ...], **_given: object) -> None:
    """Scale operational mode shapes by known added masses.

    Measure the structure twice: as it is, and with known masses attached. MODES is the file
    that `slowtime identify RECORD --method modes --out MODES` writes for the structure without
    the masses. --added takes two values: the same kind of file of the structure with the
    masses, and the mass at each channel in kg. The frequency shifts give the modal mass of each
    mode, for a shape of unit Euclidean norm, with its standard deviation. Scaled shapes are
    mass-normalised.
    """
