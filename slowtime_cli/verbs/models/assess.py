"""Arguments and help of the verb `assess`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="models.assess:assess",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime assess frame.yaml --modes 8 --setting frequency_sd=0.001
  slowtime assess frame.yaml --before healthy.json
  slowtime assess frame.yaml --before healthy.json --now today.json --report assessed.html
  slowtime assess frame.yaml --before healthy.json --now today.json --ends --out -

MODEL has `slowtime_model: 2` with a parameter for each member, or group of members, that may
change; modes files are what `slowtime identify RECORD --method modes --out` wrote.
docs/assessment.md has an example.
""",
)
@click.argument("model", type=EXISTING)
@click.option("--before", type=EXISTING, help="Modes file of the healthy state.")
@click.option("--now", type=EXISTING, help="Modes file of the present state.")
@click.option(
    "--ends",
    is_flag=True,
    help="Consider that ends of beams came loose as well; frames only.",
)
@click.option(
    "--modes",
    type=click.IntRange(min=2),
    help="Plan before measuring: number of lowest modes that the sensors of MODEL will see.",
)
@click.option(
    "--report",
    type=OutFile(".html"),
    help="HTML page to write: members in space, coloured by evidence, and tables.",
)
@out_option("JSON file to write.")
@settings_option(
    setting(
        "--model-error",
        type=Real(min=0.001, max=0.5),
        default=0.02,
        show_default=True,
        help="Relative standard deviation of the stiffness of a member about the model.",
    ),
    setting(
        "--temperature-sd",
        type=Real(min=0, max=0.5),
        default=0.02,
        show_default=True,
        help="Standard deviation of a common relative change of all stiffness, as by "
        "temperature.",
    ),
    setting(
        "--frequency-error",
        type=Real(min=0, max=1),
        default=0.001,
        show_default=True,
        help="Relative scatter of a frequency between measurements of one state, besides the "
        "standard deviation in the file.",
    ),
    setting(
        "--shape-error",
        type=Real(min=0, max=1),
        default=0.005,
        show_default=True,
        help="Likewise of a component of a shape of norm 1.",
    ),
    setting(
        "--false-alarm",
        type=Real(min=0.001, max=0.4),
        default=0.05,
        show_default=True,
        help="Probability of a change that is told where there is none.",
    ),
    setting(
        "--most",
        type=click.IntRange(1, 3),
        default=3,
        show_default=True,
        help="Largest number of members that are told to have changed.",
    ),
    setting(
        "--frequency-sd",
        type=POSITIVE,
        default=0.001,
        show_default=True,
        help="With --modes: relative standard deviation of a frequency.",
    ),
    setting(
        "--shape-sd",
        type=POSITIVE,
        default=0.01,
        show_default=True,
        help="With --modes: standard deviation of a component of a shape, over the largest.",
    ),
    setting(
        "--power",
        type=Real(min=0.1, max=0.94),
        default=0.9,
        show_default=True,
        help="Without --now: probability with which the losses of the table are found.",
    ),
)
def assess(
    before: Path | None, now: Path | None, modes: int | None, report: Path | None, **_g: object
) -> None:
    """Find members that lost stiffness between two measurements.

    Names each changed member, or the set of those that it may be, with its loss; or says that
    nothing changed, that the member is not decidable, or that the states are not comparable.
    Without --now it prints, for each member, the smallest loss that will be found.
    """
    if now is not None and before is None:
        raise click.UsageError("--now needs --before, the modes of the healthy state.")
    if (before is None) == (modes is None):
        raise click.UsageError(
            "Give either --before, a modes file, or --modes, the number of modes to plan with."
        )
    if report is not None and now is None:
        raise click.UsageError("--report needs --before and --now.")
