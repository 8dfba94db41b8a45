"""Arguments and help of the verb `design`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="models.design:design",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime design cantilever.yaml
  slowtime design damper.yaml --out tower_with_damper.yaml
  slowtime design damper.yaml --alpha 1 --alpha 0.5 --alpha 0
  slowtime design damper.yaml --out -

The file names design variables with their bounds, random inputs, an objective, and limit
states with the probability of failure that is accepted; with a model file, variables add
stiffness, damping or mass to it, and formulas may use its responses under a load.
docs/design.md lists what it may hold.
""",
)
@click.argument("design", type=EXISTING)
@click.option(
    "--alpha",
    "alphas",
    multiple=True,
    type=Real(min=0, max=1),
    help="Weight of the mean in the objective, instead of the file's: 1 is the mean alone, 0 "
    "the standard deviation alone. May be repeated: a table compares the designs.",
)
@out_option(
    "Model with the design built in (.yaml), or the figures (.json).", ".yaml", to="out_model"
)
@settings_option(
    setting(
        "--cov",
        "variation",
        type=Real(min=0, max=1, min_open=True, max_open=True),
        default=0.02,
        show_default=True,
        help="Coefficient of variation of the verified probabilities of failure.",
    ),
    setting(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of the random inputs.",
    ),
)
def design(alphas: tuple[float, ...], out_model: Path | None, **_given: object) -> None:
    """Choose a damper, mass or stiffness: cheap, robust and safe.

    Minimises alpha * mean / mean* + (1 - alpha) * sd / sd* of the objective (eq. 4.18 of the
    book), where every limit state fails with at most the accepted probability. Prints the
    variables, the objective and the verified probabilities beside those of the starting
    design. The same seed gives the same figures.
    """
    if out_model is not None and len(alphas) > 1:
        raise click.UsageError("One model can be written, of one design. Give one --alpha.")
