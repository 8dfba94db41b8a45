"""Arguments and help of the verb `fatigue`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, record_flags
from slowtime_cli.shared.options import POSITIVE, Real
from slowtime_cli.shared.outputs import out_option
from slowtime_cli.shared.settings import setting, settings_option
from slowtime_cli.verbs.models.virtual import MODEL_SETTINGS, model_flags


@click.command(
    cls=Deferred,
    fixed={"channel": None},
    work="models.fatigue:fatigue",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime fatigue stress.csv --rate-hz 100 --channels s --detail-category 71
  slowtime fatigue stress.csv --channels s \\
    --setting sn=3 --setting sn_constant=1e12 \\
    --setting mean_stress=goodman --setting strength=400
  slowtime fatigue record.csv --model frame.yaml --quantity force --element k1 \\
    --setting factor=2e-5 --setting factor_unit=MPa --detail-category 71

S-N curves are given for stress ranges, which are twice the amplitudes: N = constant /
range^slope, at the median. A constant for amplitudes is multiplied by 2^slope.
""",
)
@record_flags
@click.option(
    "--model", type=EXISTING, help="Model file: stress is estimated from accelerations instead."
)
@model_flags
@out_option("JSON file to write, with the histogram.")
@click.option(
    "--detail-category",
    type=POSITIVE,
    help="Detail category of EN 1993-1-9, such as 71. Stress is in MPa; the median of its S-N "
    "curve is used.",
)
@settings_option(
    setting("--sn", "slope", type=POSITIVE, help="Slope of the S-N curve."),
    setting(
        "--sn-constant",
        "constant",
        type=POSITIVE,
        help="Constant of the S-N curve, for stress ranges.",
    ),
    setting(
        "--knee",
        type=Real(min=0),
        default=0.0,
        help="Stress range at the knee, below which the second slope holds.",
    ),
    setting("--sn2", "lower_slope", type=POSITIVE, help="Slope below the knee."),
    setting(
        "--cut-off",
        type=Real(min=0),
        default=0.0,
        help="Cut-off: stress range below which there is no damage.",
    ),
    setting(
        "--sn-sd",
        "log10_sd",
        type=Real(min=0),
        default=0.2,
        show_default=True,
        help="Standard deviation of log10 of the life (DNV-RP-C203: 0.2 for welded steel).",
    ),
    setting(
        "--mean-stress",
        type=click.Choice(["none", "goodman", "gerber"]),
        default="none",
        show_default=True,
        help="Correction for the mean stress of cycles; needs strength.",
    ),
    setting("--strength", type=POSITIVE, help="Tensile strength, in the unit of the stress."),
    setting("--constant-mean", type=Real(), default=0.0, help="Static (mean) stress."),
    *MODEL_SETTINGS,
)
def fatigue(model: Path | None, **given: object) -> None:
    """Count stress cycles and sum fatigue damage, with its scatter.

    Cycles are counted by rainflow (ASTM E1049). Printed are Miner's sum with a 95 % interval,
    from the scatter of the S-N curve; the 5, 50 and 95 % percentiles of the time until it
    reaches the critical sum (lognormal, median 1, coefficient of variation 0.3), if the load
    goes on as in RECORD; and, for comparison, the damage that spectral methods estimate.
    """
    if (model is None) != (given["quantity"] is None):
        raise click.UsageError(
            "--model and --quantity belong together: give both for a stress that nobody "
            "measures, neither for a channel of stress."
        )
