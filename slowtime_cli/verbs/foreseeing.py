"""The verbs `forecast` and `whatif`: where a twin is heading, and what it would do today."""

from pathlib import Path
from typing import Any

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import POSITIVE, Name, Number, OutFile

from .flags import EXISTING, F, as_built, refuse_damping_alone


def of_a_twin(function: F) -> F:
    """Add the options that say which twin is asked."""
    for decorate in reversed(
        [
            click.argument("source", required=False, type=EXISTING),
            click.option(
                "--server",
                metavar="URL",
                help="Ask the twin of a running server instead, with the token in "
                "SLOWTIME_TOKEN, where it wants one.",
            ),
            click.option(
                "--asset",
                type=Name(parts=2),
                help="SITE.ASSET of the server, or of a recording that holds several.",
            ),
            click.option(
                "--registration",
                type=EXISTING,
                help="TOML or JSON file, twin id → registration, with model, thresholds and "
                "all else; instead of what follows.",
            ),
            click.option(
                "--events",
                type=EXISTING,
                help="JSON file of repairs and inspections, as `slowtime event` records them.",
            ),
            as_built,
        ]
    ):
        function = decorate(function)
    return function


@click.command(
    cls=Deferred,
    work="foreseeing:forecast",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime forecast modes.json --nominal-hz 4 --threshold -0.2
  slowtime forecast house.mcap --asset demo.tower --nominal-hz 5 --horizon 200
  slowtime forecast house.mcap --asset demo.tower --nominal-hz 5 --events events.json
  slowtime forecast --server http://127.0.0.1:8000 --asset demo.tower --threshold -0.3

SOURCE is what `slowtime evolve` takes: the file of `slowtime identify --window-s`, a recording
of features, or text with the columns slow_time, frequency_hz, frequency_sd.
""",
)
@of_a_twin
@click.option("--horizon", type=POSITIVE, help="How far ahead, in slow time.")
@click.option(
    "--points",
    type=click.IntRange(1, 200),
    default=20,
    show_default=True,
    help="At how many future times.",
)
@click.option(
    "--threshold",
    type=Number(min=-1),
    help="When is this change reached? Beside those of the registration.",
)
@click.option("--quantity", help="Of which quantity, where several are estimated.")
@click.option(
    "--toward",
    type=click.Choice(["below", "above"]),
    help="By default the side where it is not now.",
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout, and no table.",
)
def forecast(**given: Any) -> None:
    """Tell where a twin is heading, and when a threshold is reached.

    Mean and 95 % interval of each change at future slow times; of a threshold the times by
    which it is reached with 10, 50 and 90 %, or that they are not within the horizon.
    """
    refuse_half_a_twin(**given)


@click.command(
    cls=Deferred,
    work="foreseeing:whatif",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime whatif modes.json --nominal-hz 4 --load harmonic --amplitude 0.5 --frequency-hz 3.9
  slowtime whatif --server http://127.0.0.1:8000 --asset demo.frame --load step \\
    --amplitude 500 --on floor3 --quantity displacement --out answer.json
  slowtime whatif modes.json --load recorded --record quake.csv --rate-hz 100 --seed 7

A load on the base is an acceleration [m/s^2], on a node of the model a force [N].
""",
)
@of_a_twin
@click.option(
    "--load",
    "kind",
    required=True,
    type=click.Choice(["harmonic", "step", "white", "recorded"]),
    help="What acts.",
)
@click.option("--amplitude", type=Number(), help="Of a harmonic or a step.")
@click.option("--frequency-hz", type=POSITIVE, help="Of a harmonic.")
@click.option("--phase-deg", type=Number(-360, 360), help="Of a harmonic; it is a cosine.")
@click.option("--at-s", type=Number(min=0), help="Of a step: when.")
@click.option("--psd", type=Number(min=0), help="Of white noise, one-sided [unit^2/Hz].")
@click.option("--record", type=EXISTING, help="Of a recorded load: the file that holds it.")
@click.option("--channel", help="Of that file; by default its only one.")
@click.option("--on", default="base", show_default=True, help="The base, or a node.")
@click.option("--output", "outputs", multiple=True, help="Node to tell of; all by default.")
@click.option(
    "--quantity",
    type=click.Choice(["displacement", "velocity", "acceleration"]),
    default="acceleration",
    show_default=True,
    help="The first two against the base, acceleration in space.",
)
@click.option("--duration", "duration_s", type=POSITIVE, help="Seconds.")
@click.option("--rate-hz", type=POSITIVE, help="Samples per second.")
@click.option(
    "--level",
    type=Number(0, 1, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Probability of the bands.",
)
@click.option("--draws", type=click.IntRange(20, 2000), help="Structures that are drawn.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Decides every random number.",
)
@click.option(
    "--out",
    type=OutFile(stdout=True),
    help="JSON file to write, as REST answers; - for stdout, and no table.",
)
def whatif(kind: str, record: Path | None, channel: str | None, **given: Any) -> None:
    """Run today's twin under a load, with bands.

    Stiffness, mass and damping are drawn from what is believed of them now; the bands are of
    what is not known of the structure. The same seed gives the same answer.
    """
    refuse_half_a_twin(**given)
    if kind == "recorded" and record is None:
        raise click.UsageError("A recorded load needs --record FILE.")
    if kind != "recorded" and (record is not None or channel is not None):
        raise click.UsageError("--record and --channel go with --load recorded.")


def refuse_half_a_twin(
    source: object,
    server: str | None,
    asset: str | None,
    nominal_hz: float | None,
    nominal_damping: float | None,
    events: Path | None,
    **_given: object,
) -> None:
    """Refuse a question that names neither a file nor a server's twin, or both."""
    refuse_damping_alone(nominal_hz, nominal_damping)
    if source is None and server is None:
        raise click.UsageError("Give SOURCE, or --server URL with --asset SITE.ASSET.")
    if source is not None and server is not None:
        raise click.UsageError("SOURCE and --server exclude each other. Give one of them.")
    if server is not None and events is not None:
        raise click.UsageError(
            "--events goes with SOURCE. Record events of a server's twin with `slowtime event "
            "add --file`."
        )
    if server is not None and asset is None:
        raise click.UsageError("--server needs --asset SITE.ASSET.")
