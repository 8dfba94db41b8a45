"""The verbs `fatigue` and `virtual`: stress cycles and damage, and what nobody measures."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import POSITIVE, Number, OutFile

from .flags import EXISTING, record_flags

F = TypeVar("F", bound=Callable[..., Any])
QUANTITIES = ("displacement", "drift", "force", "moment")

MODEL: tuple[Callable[[F], F], ...] = (
    click.option(
        "--quantity",
        type=click.Choice(QUANTITIES),
        help="What to estimate of the model: displacement of a --node, drift --between two "
        "nodes, elastic force or moment of an --element.",
    ),
    click.option("--node", help="Of a displacement."),
    click.option(
        "--between",
        nargs=2,
        metavar="LOWER UPPER",
        help="Nodes of a drift; base is the ground.",
    ),
    click.option("--element", help="Of a force or a moment."),
    click.option(
        "--end",
        type=click.Choice(["first", "second"]),
        default="first",
        show_default=True,
        help="Of the beam whose moment is asked.",
    ),
    click.option(
        "--factor",
        type=Number(),
        help="Units for one of SI: stress in MPa for one newton is 1e-6 / area in m^2. With "
        "--factor-unit.",
    ),
    click.option("--factor-unit", help="Of the values after --factor.  [default: SI]"),
    click.option(
        "--factor-sd",
        type=Number(min=0),
        default=0.0,
        show_default=True,
        help="Relative standard deviation of --factor.",
    ),
    click.option(
        "--lowest-hz",
        type=POSITIVE,
        help="Lower edge of the band: accelerations do not show slower motion.  [default: a "
        "quarter of the model's lowest frequency]",
    ),
    click.option("--moving-base", is_flag=True, help="The base moves, and nobody measures it."),
)


def model_flags(function: F) -> F:
    """Add the options of a virtual quantity."""
    for decorate in reversed(MODEL):
        function = decorate(function)
    return function


@click.command(
    cls=Deferred,
    work="assessing:virtual",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime virtual frame.yaml record.csv --rate-hz 200 --quantity drift --between base f1
  slowtime virtual frame.yaml record.csv --quantity displacement --node f5 --out top.csv
  slowtime virtual frame.yaml record.csv --quantity force --element k1 \\
    --factor 2e-5 --factor-unit MPa

The model's sensors are named as the record's channels, and say their noise; its tolerance says
how wrong the model may be. Give both: the standard deviation rests on them. Accelerations do
not show motion slower than the band, such as the mean drift under steady wind.
""",
)
@click.argument("model", type=EXISTING)
@record_flags
@model_flags
@click.option(
    "--out", type=OutFile(), help="CSV of time, value and standard deviation; - for the pipe."
)
def virtual(**given: object) -> None:
    """Estimate drift, force or stress, which nobody measures.

    A Kalman filter runs on the accelerations of RECORD with the modes of MODEL; forces are
    unknown, and how large they are is estimated from the spectra. Models within the tolerance
    run side by side, and their spread is part of the standard deviation.
    """
    if given["quantity"] is None:
        raise click.UsageError(f"Give --quantity: {', '.join(QUANTITIES)}.")


@click.command(
    cls=Deferred,
    work="assessing:fatigue",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime fatigue stress.csv --rate-hz 100 --channel s --detail-category 71
  slowtime fatigue stress.csv --channel s --sn 3 --sn-constant 1e12 --mean-stress goodman \\
    --strength 400
  slowtime fatigue record.csv --model frame.yaml --quantity force --element k1 \\
    --factor 2e-5 --factor-unit MPa --detail-category 71

S-N curves speak of ranges, which are twice the amplitudes: N = constant / range^slope, at the
median. A constant for amplitudes is multiplied by 2^slope.
""",
)
@record_flags
@click.option("--channel", help="That measures stress.  [default: the only one]")
@click.option(
    "--model", type=EXISTING, help="Model file: stress is estimated from accelerations instead."
)
@model_flags
@click.option(
    "--detail-category",
    type=POSITIVE,
    help="Of EN 1993-1-9, such as 71: stress is in MPa, and the median is taken of its curve.",
)
@click.option("--sn", "slope", type=POSITIVE, help="Slope of the S-N curve.")
@click.option("--sn-constant", "constant", type=POSITIVE, help="Its constant, for ranges.")
@click.option("--knee", type=Number(min=0), default=0.0, help="Range of the second slope.")
@click.option("--sn2", "lower_slope", type=POSITIVE, help="Slope below the knee.")
@click.option("--cut-off", type=Number(min=0), default=0.0, help="Range without damage below.")
@click.option(
    "--sn-sd",
    "log10_sd",
    type=Number(min=0),
    default=0.2,
    show_default=True,
    help="Standard deviation of log10 of the life (DNV-RP-C203: 0.2 for welded steel).",
)
@click.option(
    "--mean-stress",
    type=click.Choice(["none", "goodman", "gerber"]),
    default="none",
    show_default=True,
    help="How means of cycles are taken into account; with --strength.",
)
@click.option("--strength", type=POSITIVE, help="Tensile strength, in the unit of the stress.")
@click.option("--constant-mean", type=Number(), default=0.0, help="Stress at rest.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with the histogram.")
def fatigue(model: Path | None, **given: object) -> None:
    """Count stress cycles and sum fatigue damage, with its scatter.

    Cycles are counted by rainflow (ASTM E1049).
    Miner's sum is given with its 95 % interval, from the scatter of lives; the time until it
    reaches the capacity (median 1, coefficient of variation 0.3) with 5, 50 and 95 % bounds;
    and beside it the damage that spectral methods estimate from the same record.
    """
    if (model is None) != (given["quantity"] is None):
        raise click.UsageError(
            "--model and --quantity belong together: give both for a stress that nobody "
            "measures, neither for a channel of stress."
        )
