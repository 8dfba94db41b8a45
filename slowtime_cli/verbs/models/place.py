"""Arguments and help of the verb `place`."""

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")


@click.command(
    cls=Deferred,
    work="models.place:place",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime model place tower.yaml --sensors 8 --modes 10
  slowtime model place tower.yaml --sensors 4 --direction ux --direction uy --together
  slowtime model place tower.yaml --sensors 12 --keep --out -
  slowtime model place frame.yaml --sensors 8 --modes 6 --setting criterion=detection

With --keep, the sensors of the model file are there already and count among --sensors.
""",
)
@click.argument("model", type=EXISTING)
@click.option(
    "--sensors",
    "number",
    type=click.IntRange(min=1),
    required=True,
    help="Number of sensors; of sites, with --together.",
)
@click.option(
    "--modes",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="Number of lowest modes that will be measured.",
)
@click.option(
    "--direction",
    "directions",
    multiple=True,
    type=click.Choice(DIRECTIONS),
    help="Direction in which a sensor may measure; may be repeated. By default all "
    "translations.",
)
@click.option("--together", is_flag=True, help="Each site has a sensor in every direction.")
@click.option("--keep", is_flag=True, help="Keep the sensors of the model file.")
@out_option("JSON file to write.")
@settings_option(
    setting(
        "--frequency-sd",
        type=POSITIVE,
        default=0.002,
        show_default=True,
        help="Relative standard deviation of a measured frequency.",
    ),
    setting(
        "--shape-sd",
        type=POSITIVE,
        default=0.02,
        show_default=True,
        help="Standard deviation of a component of a shape, over its largest component.",
    ),
    setting(
        "--criterion",
        type=click.Choice(["determinant", "variance", "detection"]),
        default="determinant",
        show_default=True,
        help="Maximise the determinant of the information, minimise the mean variance, or "
        "minimise the largest loss of a single member that `slowtime assess` just finds.",
    ),
    setting(
        "--power",
        type=Real(min=0.1, max=0.94),
        default=0.9,
        show_default=True,
        help="With criterion=detection: probability with which the printed losses are found.",
    ),
    setting(
        "--false-alarm",
        type=Real(min=0.001, max=0.4),
        default=0.05,
        show_default=True,
        help="With criterion=detection: probability of a change that is told where there is "
        "none.",
    ),
    setting(
        "--model-error",
        type=Real(min=0.001, max=0.5),
        default=0.02,
        show_default=True,
        help="With criterion=detection: relative standard deviation of the stiffness of a "
        "member about the model.",
    ),
    setting(
        "--temperature-sd",
        type=Real(min=0, max=0.5),
        default=0.02,
        show_default=True,
        help="With criterion=detection: standard deviation of a common relative change of all "
        "stiffness, as by temperature.",
    ),
)
def place(together: bool, keep: bool, **_given: object) -> None:
    """Choose the sensor positions that are most informative.

    Maximises the information that frequencies and mode shapes will give about the parameters,
    and prints the places, the expected posterior standard deviation of each parameter, and
    that of as many evenly spread sensors. With criterion=detection it minimises the largest
    loss of a single member that is found between two measurements, and prints that of each.
    """
    if together and keep:
        raise click.UsageError("Give one of --together and --keep.")
