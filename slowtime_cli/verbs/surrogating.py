"""The verb `surrogate`: runs of a slow model in, a quick function with its error out."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import OutFile

from .flags import EXISTING

KINDS = ("chaos", "matern", "squared-exponential", "hybrid", "support-vectors", "networks")
"""Of `slowtime.surrogate.choice.defaults`, in order."""


class Names(click.ParamType):  # type: ignore[type-arg]  # generic in stubs only
    """Names of columns between commas."""

    name = "NAME,NAME"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Split at the commas."""
        if isinstance(value, tuple):
            return value
        found = tuple(part.strip() for part in str(value).split(","))
        if not all(found):
            self.fail(f"{value!r} names nothing between two commas.", param, ctx)
        return found


@click.command(
    cls=Deferred,
    work="surrogating:surrogate",
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
@click.option("--output", required=True, metavar="NAME", help="Column that the model gives.")
@click.option("--inputs", type=Names(), help="Columns given to the model; by default the rest.")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(KINDS),
    metavar="NAME",
    help=f"{', '.join(KINDS)}; may be repeated. By default all are compared.",
)
@click.option("--at", type=EXISTING, help="Table of points at which to predict.")
@click.option("--out", type=OutFile(), help="CSV file for the predictions: value, sd, lo, hi.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
def surrogate(at: Path | None, out: Path | None, **_given: object) -> None:
    """Learn a quick function from runs of a slow model.

    Surrogates of Chapter 6 (polynomial chaos, Gaussian processes, the hybrid of both, support
    vectors, networks) are compared by cross-validation; the best is fitted to all runs. Prints
    their errors, how often their 95 % bands held, the Sobol' index of each input, and
    predictions with bands at the points asked for.
    """
    if out is not None and at is None:
        raise click.UsageError("--out is for predictions. Give their points with --at.")
