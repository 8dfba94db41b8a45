"""The verbs `forecast` and `whatif`: where a twin is heading, and what it would do today."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar, cast

import click

from slowtime_services.client import AnswerError, Client, UnreachableError
from slowtime_services.files import ALL
from twin_server.orders import SimulationOrder
from twin_server.pipeline import TwinKnowledge
from twin_server.registration import Registration, registrations
from twin_server.serve import ProblemError, foretell

from .evolving import Changes, as_built, registration_of, samples_of
from .offline import offline_twin
from .options import POSITIVE, STDOUT, Name, Number, OutFile
from .reading import Given, read_any, tell_reading
from .terminal import note, show, write_json

F = TypeVar("F", bound=Callable[..., Any])
IN = click.Path(exists=True, dir_okay=False, path_type=Path)
Side = Literal["below", "above"]


class Asked(NamedTuple):
    """A twin to be asked: a running server's, or one made here of a file."""

    source: Path | None
    server: str | None
    asset: str | None
    registration: Path | None
    changes: Changes
    nominal_hz: float | None
    nominal_damping: float | None
    learn_epochs: int


def _twin(function: F) -> F:
    """Add the options that say which twin is asked."""
    for decorate in reversed(
        [
            click.argument("source", required=False, type=IN),
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
                type=IN,
                help="TOML or JSON file, twin id → registration, with model, thresholds and "
                "all else; instead of what follows.",
            ),
            as_built,
        ]
    ):
        function = decorate(function)
    return function


@click.command(
    epilog="""\b
Examples:
  slowtime forecast modes.json --nominal-hz 4 --threshold -0.2
  slowtime forecast house.mcap --asset demo.tower --nominal-hz 5 --horizon 200
  slowtime forecast --server http://127.0.0.1:8000 --asset demo.tower --threshold -0.3

SOURCE is what `slowtime evolve` takes: the file of `slowtime identify --window-s`, a recording
of features, or text with the columns slow_time, frequency_hz, frequency_sd.
"""
)
@_twin
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
def forecast(
    horizon: float | None,
    points: int,
    threshold: float | None,
    quantity: str | None,
    toward: Side | None,
    out: Path | None,
    **twin: Any,
) -> None:
    """Tell where a twin is heading, and when a threshold is reached.

    Mean and 95 % interval of each change at future slow times; of a threshold the times by
    which it is reached with 10, 50 and 90 %, or that they are not within the horizon.
    """
    asked = Asked(**twin)
    more = {"threshold": threshold, "quantity": quantity, "toward": toward}
    if asked.server is not None:
        query = {"horizon": horizon, "points": points, **more}
        body = _of_server(asked, "GET", "forecast", query=query)
    else:
        with _made(asked) as (knowledge, twin_id, registration), _said():
            body = foretell(
                knowledge, twin_id, registration, horizon, points,
                threshold=threshold, quantity=quantity, toward=toward,
            )  # fmt: skip
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show_forecast(body)
    for reason in body["reasons"]:
        note(reason)
    for crossing in body["crossings"] if out != STDOUT else ():
        note(crossing["sentence"])


@click.command(
    epilog="""\b
Examples:
  slowtime whatif modes.json --nominal-hz 4 --load harmonic --amplitude 0.5 --frequency-hz 3.9
  slowtime whatif --server http://127.0.0.1:8000 --asset demo.frame --load step \\
    --amplitude 500 --on floor3 --quantity displacement --out answer.json
  slowtime whatif modes.json --load recorded --record quake.csv --rate-hz 100 --seed 7

A load on the base is an acceleration [m/s^2], on a node of the model a force [N].
"""
)
@_twin
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
@click.option("--record", type=IN, help="Of a recorded load: the file that holds it.")
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
def whatif(
    kind: str,
    record: Path | None,
    channel: str | None,
    outputs: tuple[str, ...],
    out: Path | None,
    **options: Any,
) -> None:
    """Run today's twin under a load, with bands.

    Stiffness, mass and damping are drawn from what is believed of them now; the bands are of
    what is not known of the structure. The same seed gives the same answer.
    """
    asked = Asked(**{name: options.pop(name) for name in Asked._fields})
    of_load = ("amplitude", "frequency_hz", "phase_deg", "at_s", "psd")
    given = {name: options.pop(name) for name in of_load}
    load: dict[str, Any] = {"kind": kind} | _without_none(given)
    if kind == "recorded":
        load["samples"], options["rate_hz"] = _recorded(record, channel, options["rate_hz"])
    elif record is not None or channel is not None:
        raise click.UsageError("--record and --channel go with --load recorded.")
    more = {"outputs": list(outputs)} if outputs else {}
    order = SimulationOrder.model_validate({"load": load, **_without_none(options), **more})
    if asked.server is not None:
        body = _of_server(
            asked, "POST", "simulate", body=order.model_dump(mode="json", exclude_none=True)
        )
    else:
        with _made(asked) as (knowledge, twin_id, _), _said():
            body = knowledge.simulate(twin_id, order)
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show_response(body)
    for reason in body["reasons"]:
        note(reason)
    if body["assumed"]:
        note(f"taken for granted: {', '.join(body['assumed'])}.")


def _without_none(given: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in given.items() if value is not None}


def _recorded(
    path: Path | None, channel: str | None, rate_hz: float | None
) -> tuple[list[float], float]:
    if path is None:
        raise click.UsageError("A recorded load needs --record FILE.")
    record = read_any(path, Given(rate_hz=rate_hz, keep=(ALL,)))
    tell_reading(record)
    if record.gaps:
        raise click.UsageError(f"{path.name} lacks samples. Cut it at its gaps.")
    names = record.channels
    if channel is None and len(names) != 1:
        raise click.UsageError(f"{path.name} has {', '.join(names)}. Name one with --channel.")
    if channel is not None and channel not in names:
        raise click.UsageError(
            f"{path.name} has no {channel}, but: {', '.join(names)}. Name one with --channel."
        )
    column = names.index(channel) if channel is not None else 0
    samples = record.samples[:, column].astype(float).tolist()
    return cast(list[float], samples), record.rate_hz


@contextlib.contextmanager
def _made(asked: Asked) -> Iterator[tuple[TwinKnowledge, str, Registration]]:
    """Make a twin of a file, and let it be asked."""
    if asked.source is None:
        raise click.UsageError("Give SOURCE, or --server URL with --asset SITE.ASSET.")
    twin_id, samples = samples_of(asked.source, asked.asset)
    registration = _registration(asked, twin_id)
    with offline_twin() as (pipeline, store):
        pipeline.register(twin_id, registration)
        pipeline.ingest(samples)
        pipeline.give_up()
        if not len(store.history(twin_id, limit=1).states):
            raise click.UsageError(f"{asked.source} holds no epoch. Give one with some.")
        yield TwinKnowledge(pipeline, store), twin_id, registration


def _registration(asked: Asked, twin_id: str) -> Registration:
    if asked.registration is not None:
        found = registrations(asked.registration)
        if twin_id in found:
            return found[twin_id]
        if len(found) == 1 and asked.asset is None:
            return next(iter(found.values()))
        raise click.UsageError(
            f"{asked.registration} registers {', '.join(found) or 'nothing'}, not {twin_id}. "
            "Name one of them with --asset, or add it."
        )
    return registration_of(
        asked.changes, asked.nominal_hz, asked.nominal_damping, asked.learn_epochs
    )


@contextlib.contextmanager
def _said() -> Iterator[None]:
    """Say what a twin says of a question that cannot be answered."""
    try:
        yield
    except ProblemError as error:
        raise click.UsageError(error.detail) from error


def _of_server(
    asked: Asked,
    method: str,
    what: str,
    *,
    query: dict[str, Any] | None = None,
    body: object = None,
) -> dict[str, Any]:
    """Ask a running twin server."""
    if asked.source is not None:
        raise click.UsageError("SOURCE and --server exclude each other. Give one of them.")
    if asked.asset is None:
        raise click.UsageError("--server needs --asset SITE.ASSET.")
    assert asked.server is not None
    try:
        client = Client(asked.server, timeout_s=120.0)
        return client.json(method, f"/twins/{asked.asset}/{what}", query, body)
    except (AnswerError, UnreachableError, ValueError) as error:
        raise click.UsageError(str(error)) from error


def _show_forecast(body: dict[str, Any]) -> None:
    rows, plain = [], []
    for point in body["points"]:
        whole = {name: point[name] for name in ("stiffness_change", "mass_change")}
        for name, estimate in {**_without_none(whole), **point["elements"]}.items():
            cells = [f"{100 * estimate[part]:.2f}" for part in ("value", "sd", "lo", "hi")]
            rows.append((f"{point['slow_time']:.6g}", name, *cells))
            plain.append({"slow_time": point["slow_time"], "quantity": name, **estimate})
    heads = ("slow time", "quantity", "change [%]", "sd [%]", "lo [%]", "hi [%]")
    show("", heads, rows, plain=plain)


def _show_response(body: dict[str, Any]) -> None:
    if not sys.stdout.isatty():
        lines = [
            {
                "t_s": body["t_s"][row],
                "load": body["load"][row],
                **{
                    f"{name}_{part}": out[part][row]
                    for name, out in body["outputs"].items()
                    for part in ("value", "sd", "lo", "hi")
                },
            }
            for row in range(len(body["t_s"]))
        ]
        show("", (), (), plain=lines)
        return
    rows = [
        (name, what, *(f"{out[what][part]:.4g}" for part in ("value", "sd", "lo", "hi")))
        for name, out in body["outputs"].items()
        for what in ("peak", "rms")
    ]
    unit = body["unit"]
    heads = ("node", body["quantity"], f"value [{unit}]", f"sd [{unit}]", "lo", "hi")
    show("", heads, rows, plain=[])
