"""Arguments and help of the verb `whatif`."""

from pathlib import Path
from typing import Any

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import CHANGES, EXISTING, LEARN_EPOCHS
from slowtime_cli.shared.options import POSITIVE, OutFile, Real
from slowtime_cli.shared.settings import setting, settings_option
from slowtime_cli.verbs.twins.twin_flags import EVENTS, refuse_incomplete_query, twin_flags

NEEDED = {"harmonic": ("amplitude", "frequency_hz"), "step": ("amplitude",), "white": ("psd",)}
"""Kind of load → options without which it is no load."""


@click.command(
    cls=Deferred,
    work="twins.whatif:whatif",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime twin whatif modes.json --nominal-hz 4 --load harmonic --amplitude 0.5 \\
    --frequency-hz 3.9
  slowtime twin whatif --server http://127.0.0.1:8000 --asset demo.frame --load step \\
    --amplitude 500 --setting on=floor3 --setting quantity=displacement --out answer.json
  slowtime twin whatif modes.json --load recorded --record quake.csv --rate-hz 100

A load on the base is an acceleration [m/s^2], on a node of the model a force [N].
""",
)
@twin_flags
@click.option(
    "--load",
    "kind",
    required=True,
    type=click.Choice(["harmonic", "step", "white", "recorded"]),
    help="Kind of load.",
)
@click.option("--amplitude", type=Real(), help="Amplitude of a harmonic or a step.")
@click.option("--frequency-hz", type=POSITIVE, help="Frequency of a harmonic.")
@click.option("--record", type=EXISTING, help="File that holds a recorded load.")
@click.option(
    "--output",
    "outputs",
    multiple=True,
    help="Node whose response is computed; by default all.",
)
@click.option("--duration", "duration_s", type=POSITIVE, help="Seconds.")
@click.option("--rate-hz", type=POSITIVE, help="Samples per second.")
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout instead of the table.",
)
@settings_option(
    setting(
        "--on",
        default="base",
        show_default=True,
        help="Where the load acts: the base, or a node.",
    ),
    setting(
        "--psd",
        type=Real(min=0),
        help="Density of white noise, one-sided [unit^2/Hz].",
    ),
    setting(
        "--quantity",
        type=click.Choice(["displacement", "velocity", "acceleration"]),
        default="acceleration",
        show_default=True,
        help="Displacement and velocity relative to the base, acceleration absolute.",
    ),
    setting(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of the random numbers.",
    ),
    setting("--phase-deg", type=Real(-360, 360), help="Phase of a harmonic; it is a cosine."),
    setting("--at-s", type=Real(min=0), help="Start of a step."),
    setting("--channel", help="Channel of that file; by default its only one."),
    setting(
        "--level",
        type=Real(0, 1, min_open=True, max_open=True),
        default=0.95,
        show_default=True,
        help="Probability of the bands.",
    ),
    setting("--draws", type=click.IntRange(20, 2000), help="Number of structures sampled."),
    CHANGES,
    LEARN_EPOCHS,
    EVENTS,
)
def whatif(kind: str, record: Path | None, channel: str | None, **given: Any) -> None:
    """Simulate a twin's current structure under a load, with bands.

    Stiffness, mass and damping are drawn from their present estimates; the bands follow from
    the uncertainty of these. The same seed gives the same answer.
    """
    refuse_incomplete_query(**given)
    if kind == "recorded" and record is None:
        raise click.UsageError("A recorded load needs --record FILE.")
    if kind != "recorded" and (record is not None or channel is not None):
        raise click.UsageError("--record and the setting channel go with --load recorded.")
    missing = [name for name in NEEDED.get(kind, ()) if given[name] is None]
    if missing:
        options = " and ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise click.UsageError(f"--load {kind} needs {options}. Give a number for each.")
