"""Arguments and help of the verb `virtual`."""

from collections.abc import Callable

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, F, record_flags
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.settings import setting, settings_option

QUANTITIES = ("displacement", "drift", "force", "moment")
MODEL: tuple[Callable[[F], F], ...] = (
    click.option(
        "--quantity",
        type=click.Choice(QUANTITIES),
        help="Quantity to estimate: displacement of a --node, drift --between two "
        "nodes, elastic force or moment of an --element.",
    ),
    click.option("--node", help="Node of a displacement."),
    click.option(
        "--between",
        nargs=2,
        metavar="LOWER UPPER",
        help="Nodes of a drift; base is the ground.",
    ),
    click.option("--element", help="Element of a force or a moment."),
)
MODEL_SETTINGS = (
    setting(
        "--end",
        type=click.Choice(["first", "second"]),
        default="first",
        show_default=True,
        help="End of the beam at which the moment is estimated.",
    ),
    setting(
        "--factor",
        type=Real(),
        help="Factor from SI units to the unit given with factor_unit; for stress in MPa "
        "from a force: 1e-6 / area in m^2.",
    ),
    setting("--factor-unit", help="Unit of the values after the factor.  [default: SI]"),
    setting(
        "--factor-sd",
        type=Real(min=0),
        default=0.0,
        show_default=True,
        help="Relative standard deviation of the factor.",
    ),
    setting(
        "--lowest-hz",
        type=POSITIVE,
        help="Lower edge of the band: accelerations do not show slower motion.  [default: a "
        "quarter of the model's lowest frequency]",
    ),
    setting("--moving-base", is_flag=True, help="The base has an unmeasured motion."),
)
"""Rare settings of a virtual quantity."""


def model_flags(function: F) -> F:
    """Add the options of a virtual quantity."""
    for decorate in reversed(MODEL):
        function = decorate(function)
    return function


@click.command(
    cls=Deferred,
    work="models.virtual:virtual",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime virtual frame.yaml record.csv --rate-hz 200 --quantity drift --between base f1
  slowtime virtual frame.yaml record.csv --quantity displacement --node f5 --out top.csv
  slowtime virtual frame.yaml record.csv --quantity force --element k1 \\
    --setting factor=2e-5 --setting factor_unit=MPa

The model's sensors are named as the record's channels, and say their noise; its tolerance says
how wrong the model may be. Give both: the standard deviation rests on them. Accelerations do
not show motion slower than the band, such as the mean drift under steady wind.
""",
)
@click.argument("model", type=EXISTING)
@record_flags
@model_flags
@settings_option(*MODEL_SETTINGS)
@click.option(
    "--out",
    type=OutFile(),
    help="CSV file of time, value and standard deviation; - for stdout.",
)
def virtual(**given: object) -> None:
    """Estimate drift, force or stress that nobody measures.

    Virtual sensing: a Kalman filter runs on the accelerations of RECORD with the modes of
    MODEL. Forces are unknown, and how large they are is estimated from the spectra of the
    accelerations. The filter also runs with variants of MODEL within the tolerances that it
    states, and the spread between them is part of the standard deviation.
    """
    if given["quantity"] is None:
        raise click.UsageError(f"Give --quantity: {', '.join(QUANTITIES)}.")
