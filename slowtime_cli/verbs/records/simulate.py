"""Arguments and help of the verb `simulate`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.demo_structures import STRUCTURES
from slowtime_cli.shared.flags import EXISTING, Effects
from slowtime_cli.shared.options import POSITIVE, OutFile, together
from slowtime_cli.shared.settings import setting, settings_option


@click.command(
    cls=Deferred,
    work="records.simulate:simulate",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime simulate --structure tower --epochs 8 --out tower.mcap
  slowtime simulate --structure wing --epochs 20 --seed 7 --out wing.npz
  slowtime simulate --structure frame --epochs 4 --out frame.npz
  slowtime simulate --model rig.yaml --input shaker.csv --out rig.npz
  slowtime simulate --model tower.yaml --duration 600 --rate-hz 50 --seed 1 --out tower.npz
  slowtime simulate --model rig.yaml --setting initial=m1=0.02 --out d.npz \\
    --duration 9 --rate-hz 50
""",
)
@click.option(
    "--structure",
    "name",
    type=click.Choice(sorted(STRUCTURES)),
    help="Name of a built-in structure.",
)
@click.option("--model", type=EXISTING, help="Model file (YAML) to run instead.")
@click.option(
    "--input",
    "record",
    type=EXISTING,
    metavar="RECORD",
    help="With --model: record that holds its inputs, by channel name.",
)
@click.option(
    "--epochs",
    default=100,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of records.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random numbers.")
@click.option(
    "--rate-hz",
    type=POSITIVE,
    help="With --model: sampling rate, if no record states one.",
)
@click.option(
    "--duration",
    "duration_s",
    type=POSITIVE,
    help="With --model without inputs: seconds of ambient vibration.",
)
@click.option("--noise", is_flag=True, help="Add each sensor's noise_sd; needs --seed.")
@click.option(
    "--out",
    required=True,
    type=OutFile(".mcap", ".npz"),
    help="MCAP or NumPy (.npz) file to write.",
)
@settings_option(
    setting(
        "--effects",
        multiple=True,
        type=Effects(),
        metavar="FILE|NAME",
        help="With --model: Python file with effects of your own, or name of an installed "
        "plug-in; may be repeated.",
    ),
    setting(
        "--force-psd",
        default=1.0,
        show_default=True,
        type=POSITIVE,
        help="Density of the ambient force on each node, one-sided [N^2/Hz].",
    ),
    setting(
        "--hold",
        default="first",
        show_default=True,
        type=click.Choice(["first", "zero", "band_limited"]),
        help="With --model: interpolation between samples of inputs that have no `hold` in the "
        "model file: linear (first), held (zero), or limited to half the sampling rate "
        "(band_limited). An imposed displacement is always band_limited.",
    ),
    setting(
        "--initial",
        multiple=True,
        metavar="NODE=DISPLACEMENT[,VELOCITY]",
        help="With --model: initial state of a node relative to the base [m, m/s; rad, "
        "rad/s], in place of the one in the model; may be repeated.",
    ),
)
def simulate(name: str | None, model: Path | None, **_given: object) -> None:
    """Write the vibration of an ageing structure or of a model file.

    With --structure, epoch by epoch: MCAP holds raw blocks and the true values; .npz holds the
    samples (epoch, time), their slow times and the true values.

    With --model, its effects included: under the inputs found in RECORD, from rest or from the
    initial state in the model or in `--setting initial=`. A model without inputs decays freely
    from its initial state; without one, it is stationary under ambient forces. OUT (.npz) holds
    t [s] and one array for each sensor.
    """
    together((("--structure", name), ("--model", model)))
    if name is None and model is None:
        raise click.UsageError("Missing option '--structure' or '--model'. Give one of them.")
