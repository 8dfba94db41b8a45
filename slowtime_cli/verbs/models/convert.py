"""Arguments and help of the verb `convert`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import OutFile


@click.command(
    cls=Deferred,
    work="models.convert:convert",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime model convert tower.bdf --out tower.yaml
  slowtime model convert tower.inp --out tower.yaml --unit mm --parameters

Read are beams, bars, flat shells, springs, masses, rigid links, relations and supports of
Nastran (.bdf, .dat, .nas) and of Abaqus or CalculiX (.inp). docs/matrices.md lists the cards.
""",
)
@click.argument("mesh", type=EXISTING)
@click.option(
    "--out", required=True, type=OutFile(".yaml"), help="Model file to write, with a `frame`."
)
@click.option(
    "--unit",
    type=click.Choice(["m", "mm", "in"]),
    default="m",
    show_default=True,
    help="Unit system of the mesh, by its length unit: m (m, N, kg), mm (mm, N, tonne) or in "
    "(in, lbf, lbf s^2/in).",
)
@click.option(
    "--parameters",
    is_flag=True,
    help="Define a stiffness parameter for each property or section.",
)
def convert(**_given: object) -> None:
    """Convert a mesh of beams, bars and shells to a model file.

    The sections of the mesh become groups of elements, which parameters scale. Entries that are
    not supported and may affect the result are listed in an error. `slowtime model reduce`
    prints the natural frequencies of the model file; sensors and inputs are added to it by
    hand.
    """
