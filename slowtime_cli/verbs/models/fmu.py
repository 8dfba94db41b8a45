"""Arguments and help of the verb `fmu`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, OutFile


@click.command(
    cls=Deferred,
    work="models.fmu:fmu",
    extra="fmu",
    epilog="""\b
Examples:
  slowtime model fmu rig.yaml --out rig.fmu
  slowtime model fmu tower.yaml --out tower.fmu --step-s 0.002

Finite-element models are reduced first. MODEL may be the augmented.yaml of `diagnose`.
docs/fmu.md says how other programs run the unit.
""",
)
@click.argument("model", type=EXISTING)
@click.option("--out", required=True, type=OutFile(".fmu"), help="Unit to write.")
@click.option(
    "--step-s",
    type=POSITIVE,
    default=0.001,
    show_default=True,
    help="Step that the unit proposes [s]; any other may be taken.",
)
def fmu(**_given: object) -> None:
    """Export a model as an FMU for other simulation programs.

    Writes a functional mock-up unit (FMI 2.0, co-simulation). Its inputs are the forces and
    base accelerations of the model file, its outputs the sensors, its parameters the relative
    changes of groups and the constants of elements and effects. The program that runs it needs
    a Python that can import slowtime.
    """
