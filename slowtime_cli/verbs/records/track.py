"""Arguments and help of the verb `track`."""

import itertools

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import Names
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option


class Times(click.ParamType):  # type: ignore[type-arg]  # generic in stubs only
    """Slow times between commas, ascending."""

    name = "TIME,TIME"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Read the numbers."""
        if isinstance(value, tuple):
            return value
        try:
            found = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} are no numbers between commas.", param, ctx)
        if any(later <= earlier for earlier, later in itertools.pairwise(found)):
            self.fail(f"{value!r} do not ascend.", param, ctx)
        return found


@click.command(
    cls=Deferred,
    work="records.track:track_records",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime modes track rig.yaml monday.csv tuesday.csv --setting white_force=0.5
  slowtime modes track rig.yaml day*.csv --at 0,30,60,90 --free mount.stiffness \\
    --setting forecast_to=180
  slowtime modes track rig.yaml run.csv --out -

The model lists inputs and acceleration sensors; its effects are laws without memory, such as
cubic_hardening or van_der_pol.
""",
)
@click.argument("model", type=EXISTING)
@click.argument("records", nargs=-1, required=True)
@click.option(
    "--free",
    type=Names(),
    help="Constants to estimate, such as mount.stiffness; by default every stiffness, damping "
    "and parameter of an effect.",
)
@click.option("--at", type=Times(), help="Slow time of each record; by default 0, 1, 2, ...")
@click.option(
    "--rate-hz",
    type=click.FloatRange(min=0, min_open=True),
    help="Sampling rate of the records [Hz].",
)
@out_option("CSV file of the constants, one row for each record, or JSON.", ".csv", to="out")
@settings_option(
    setting(
        "--white-force",
        type=click.FloatRange(min=0),
        default=0.0,
        show_default=True,
        help="Unmeasured white force on every node: square root of its density [N s^(1/2)].",
    ),
    setting(
        "--force-sd",
        type=click.FloatRange(min=0),
        help="Error of the measured force [N]; by default 1 % of its rms.",
    ),
    setting(
        "--forecast-to",
        type=float,
        help="Slow time to which each constant is forecast, from five records on.",
    ),
)
def track(records: tuple[str, ...], at: tuple[float, ...] | None, **_given: object) -> None:
    """Track the constants of a nonlinear structure over slow time.

    A joint unscented filter of motion and constants goes through each record, under measured
    and white forces (Chapter 9 of the book). Prints each constant with its standard deviation
    and the normalised squared residual of the record, about 1 if the model is right. From five
    records on, Gaussian processes over slow time forecast each constant.
    """
    if at is not None and len(at) != len(records):
        raise click.UsageError(
            f"--at gives {len(at)} slow times for {len(records)} records. Give one for each."
        )
