"""Arguments and help of the verb `reduce`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="models.reduce:reduce",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime model reduce tower.yaml --modes 20
  slowtime model reduce tower.yaml --modes 20 --report shapes.html
  slowtime model reduce tower.yaml --band-hz 8 --out tower.npz
  slowtime model reduce tower.yaml --band-hz 8 --setting coordinates=60 --out small.json
  slowtime model reduce tower.yaml --modes 20 --setting span=0.5 --setting trials=5 --out -

The model file has `slowtime_model: 2` and either `matrices`, files of stiffness, mass and of
what each parameter scales, or `frame`. docs/matrices.md lists formats and keys. Give one of
--modes and --band-hz. A key `band_hz` of the file replaces neither of them; it determines the
modes of a model file (.yaml or .json) that --out writes.
""",
)
@click.argument("model", type=EXISTING)
@click.option("--modes", type=click.IntRange(min=1), help="Number of lowest modes to keep.")
@click.option(
    "--report",
    type=OutFile(".html"),
    help="HTML page to write: frequencies, and animated mode shapes in space.",
)
@out_option(
    "Reduced model: .yaml or .json as a model file, for a twin, diagnose and simulate; .npz "
    "for updating in Python.",
    ".yaml",
    ".json",
    ".npz",
    to="out",
)
@settings_option(
    setting(
        "--band-hz",
        type=POSITIVE,
        help="Upper end of the sensors' band, instead of --modes: modes up to 1.5 times it are "
        "kept.",
    ),
    setting(
        "--coordinates",
        type=click.IntRange(min=1),
        default=100,
        show_default=True,
        help="Maximum number of coordinates.",
    ),
    setting(
        "--span",
        type=Real(min=0, max=1, min_open=True, max_open=True),
        default=0.3,
        show_default=True,
        help="Largest relative change of a parameter for which the model must hold.",
    ),
    setting(
        "--trials",
        type=click.IntRange(min=0),
        default=2,
        show_default=True,
        help="Random parameters at which the model is verified by full solutions.",
    ),
    setting(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of the random parameters of the trials.",
    ),
)
def reduce(modes: int | None, band_hz: float | None, **_given: object) -> None:
    """Reduce finite-element matrices to a small model and verify it.

    Keeps the lowest modes and their responses to every parameter, so that a changed parameter
    needs no solution of the full model. Prints the natural frequencies, and the largest error
    of frequencies and shapes at random parameters.
    """
    if (modes is None) == (band_hz is None):
        raise click.UsageError("Give one of --modes and --band-hz.")
