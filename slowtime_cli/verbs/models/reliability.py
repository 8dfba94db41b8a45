"""Arguments and help of the verb `reliability`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.report_flags import report_flag, wording
from slowtime_cli.shared.settings import setting, settings_option

METHODS = (
    "mean-value", "form", "sorm-breitung", "sorm-tvedt", "system", "monte-carlo", "stratified",
    "importance", "directional", "subset", "cross-entropy", "active",
)  # fmt: skip
"""Of `slowtime.reliability.METHODS`, repeated as importing it takes a second; a test holds
them to it."""

DEFAULT = ("form", "importance", "subset")


@click.command(
    cls=Deferred,
    work="models.reliability:reliability",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime reliability column.yaml
  slowtime reliability column.yaml --method form --method directional --setting cov=0.02
  slowtime reliability column.yaml --method all --out -
  slowtime reliability inputs.yaml --limit-state own_model.py --method active
  slowtime reliability problem.py

The file names inputs, their distributions and dependence, and a formula that fails where it is
at most 0; docs/reliability.md lists what it may hold. A Python file is executed, so give only
your own.
""",
)
@click.argument("problem", type=EXISTING)
@click.option(
    "--limit-state",
    type=EXISTING,
    metavar="FILE.py",
    help="Python file of your own whose function g is the limit state; its arguments are "
    "inputs by name, or one array [sample input].",
)
@click.option(
    "--method",
    "methods",
    multiple=True,
    type=click.Choice([*METHODS, "all"]),
    metavar="NAME",
    help=f"{', '.join(METHODS)}, or all; may be repeated.  [default: {', '.join(DEFAULT)}]",
)
@report_flag
@out_option("JSON file to write.")
@settings_option(
    setting(
        "--cov",
        "variation",
        type=Real(min=0, max=1, min_open=True, max_open=True),
        default=0.05,
        show_default=True,
        help="Coefficient of variation of the probability at which sampling stops.",
    ),
    setting(
        "--calls",
        type=click.IntRange(min=1),
        default=5_000_000,
        show_default=True,
        help="Maximum number of evaluations of the limit state, for each method.",
    ),
    setting(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of the random samples.",
    ),
    *wording(),
)
def reliability(problem: Path, limit_state: Path | None, **_given: object) -> None:
    """Compute a probability of failure by several methods.

    Each method gives probability, 95 % interval, reliability index, coefficient of variation
    and number of evaluations of the limit state; approximations (mean-value, form, sorm,
    system) give no interval. Design points are listed with the importance of each input. The
    same seed gives the same figures.
    """
    if limit_state is not None and problem.suffix == ".py":
        raise click.UsageError(
            "A Python problem holds its own limit state. Leave --limit-state out."
        )
