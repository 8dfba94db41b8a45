"""Arguments and help of the verb `update`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import OutFile, Real
from slowtime_cli.shared.outputs import out_option


@click.command(
    cls=Deferred,
    work="models.update:update",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime model update tower.yaml modes.json
  slowtime model update tower.yaml modes.json --report updated.html
  slowtime model update tower.yaml modes.json --frequency-error 0.005 --out -

MODEL has `slowtime_model: 2` with `matrices` or `frame`, parameters and sensors; MODES is what
`slowtime identify RECORD --method modes --out` wrote. docs/matrices.md has an example.
""",
)
@click.argument("model", type=EXISTING)
@click.argument("modes", type=EXISTING)
@click.option(
    "--frequency-error",
    type=Real(min=0, max=1),
    default=0.002,
    show_default=True,
    help="Relative standard deviation of frequencies due to model errors that no parameter "
    "can explain.",
)
@click.option(
    "--shape-error",
    type=Real(min=0, max=1),
    default=0.02,
    show_default=True,
    help="Standard deviation of components of shapes of norm 1 due to model errors that no "
    "parameter can explain.",
)
@click.option(
    "--report",
    type=OutFile(".html"),
    help="HTML page to write: tables, measured and model mode shapes in space, and MAC.",
)
@out_option("JSON file to write.")
def update(**_given: object) -> None:
    """Update a finite-element model from measured modes.

    Prints the change of each parameter with its standard deviation and its ratio to the prior
    one, the parameters that the modes do not determine, and measured and model frequencies.
    """
