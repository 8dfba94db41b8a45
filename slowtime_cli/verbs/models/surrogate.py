"""Arguments and help of the verb `surrogate`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Names
from slowtime_cli.shared.outputs import out_option

KINDS = ("chaos", "matern", "squared-exponential", "hybrid", "support-vectors", "networks")
"""Of `slowtime.surrogate.choice.defaults`, in order."""


@click.command(
    cls=Deferred,
    fixed={"seed": 0},
    work="models.surrogate:surrogate",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime surrogate runs.csv --output frequency_hz
  slowtime surrogate runs.csv --output peak --inputs stiffness,mass --at points.csv
  slowtime surrogate runs.csv --output peak --at points.csv --out predicted.csv

A table is text with a heading and one run a row, between commas, semicolons or tabs.
""",
)
@click.argument("runs", type=EXISTING)
@click.option(
    "--output", required=True, metavar="NAME", help="Column with the output of the model."
)
@click.option(
    "--inputs",
    type=Names(),
    help="Columns with the inputs of the model; by default all others.",
)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(KINDS),
    metavar="NAME",
    help=f"{', '.join(KINDS)}; may be repeated. By default all are compared.",
)
@click.option("--at", type=EXISTING, help="Table of points at which to predict.")
@out_option("CSV file for the predictions (value, sd, lo, hi), or JSON.", ".csv", to="out")
def surrogate(at: Path | None, out: Path | None, **_given: object) -> None:
    """Fit a fast surrogate to runs of a slow model.

    Surrogates of Chapter 6 (polynomial chaos, Gaussian processes, the hybrid of both, support
    vectors, networks) are compared by cross-validation; the best is fitted to all runs. Prints
    their errors, how often their 95 % bands held, the Sobol' index of each input, and
    predictions with bands at the points asked for.
    """
    if out is not None and at is None:
        raise click.UsageError("--out is for predictions. Give their points with --at.")
