"""The verb `evolve`: frequencies and damping over slow time in, stiffness and mass out."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import click
from rich.console import Console
from rich.table import Table

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample
from slowtime_services.replay import contents, read_recording
from twin_server.registration import Nominal, Registration
from twin_server.rendering import points, state_objects

from .offline import offline_twin

SITE, ASSET = "offline", "record"


@click.command(
    epilog="""\b
Examples:
  slowtime evolve modes.json --changes stiffness
  slowtime evolve house.mcap --asset demo.tower --nominal-hz 5 --nominal-damping 0.01
  slowtime evolve frequencies.csv --changes mass --out evolution.json

A text file has a header and the columns slow_time, frequency_hz, frequency_sd and, where the
damping is known, damping_ratio and damping_sd.
"""
)
@click.argument("source", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--changes",
    type=click.Choice(["stiffness", "mass", "both"]),
    default="stiffness",
    show_default=True,
    help="What may change; the rest is assumed to stay.",
)
@click.option(
    "--nominal-hz",
    type=click.FloatRange(min=0, min_open=True),
    help="Natural frequency as built.  [default: learnt from the first epochs]",
)
@click.option("--nominal-damping", type=click.FloatRange(0, 1), help="Damping ratio as built.")
@click.option(
    "--learn-epochs",
    type=click.IntRange(min=2),
    default=20,
    show_default=True,
    help="Epochs from which the nominal model is learnt.",
)
@click.option("--asset", help="SITE.ASSET, where a recording holds several.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="JSON file to write: {points: [state, ...]}.",
)
def evolve(
    source: Path,
    changes: Literal["stiffness", "mass", "both"],
    nominal_hz: float | None,
    nominal_damping: float | None,
    learn_epochs: int,
    asset: str | None,
    out: Path | None,
) -> None:
    """Tell how stiffness and mass have changed, from frequencies over slow time.

    SOURCE is what `slowtime identify --window-s` wrote, an MCAP recording of features, or a
    text file. Each epoch is judged by its own standard deviation.
    """
    if nominal_damping is not None and nominal_hz is None:
        raise click.UsageError("--nominal-damping goes with --nominal-hz.")
    nominal = (
        None
        if nominal_hz is None
        else Nominal(frequency_hz=nominal_hz, damping_ratio=nominal_damping)
    )
    registration = Registration(changes=changes, nominal=nominal, learn_epochs=learn_epochs)
    twin_id, samples = _samples(source, asset)
    with offline_twin() as (pipeline, store):
        pipeline.register(twin_id, registration)
        pipeline.ingest(samples)
        pipeline.give_up()
        history = store.history(twin_id)
        boots, units = (
            zip(*(history.boots[number] for number in history.number), strict=True)
            if history.number
            else ((), ())
        )
        body = points(state_objects(history.states, twin_id, boots, units))
    states = json.loads(body)["points"]
    if not states:
        raise click.UsageError(f"{source} holds no epoch.")
    _show(states, changes)
    if out is not None:
        out.write_text(json.dumps({"points": states}, indent=1) + "\n")


def _samples(source: Path, asset: str | None) -> tuple[str, Iterator[Sample]]:
    if source.suffix.lower() == ".mcap":
        return _of_recording(source, asset)
    if asset is not None:
        raise click.UsageError("--asset goes with an MCAP recording.")
    rows = _of_json(source) if source.suffix.lower() == ".json" else _of_text(source)
    return f"{SITE}.{ASSET}", (
        Sample(FEATURES.key(SITE, ASSET), encode(features), None, replayed=True)
        for features in rows
    )


def _of_recording(source: Path, asset: str | None) -> tuple[str, Iterator[Sample]]:
    counts = contents(source, streams=[FEATURES]).counts
    assets = sorted(".".join(key.split("/")[2:4]) for key, count in counts.items() if count)
    if asset is None and len(assets) != 1:
        raise click.UsageError(
            f"{source} holds {', '.join(assets) or 'no features'}. Name one with --asset."
        )
    if asset is not None and asset not in assets:
        raise click.UsageError(
            f"{source} has no {asset}, but: {', '.join(assets) or 'nobody'}."
        )
    twin_id = asset or assets[0]
    key = FEATURES.key(*twin_id.split(".", 1))
    return twin_id, (
        Sample(message.key, message.payload, message.publish_ns, replayed=True)
        for message in read_recording(source, streams=[FEATURES])
        if message.key == key
    )


def _of_json(source: Path) -> Iterator[Features]:
    try:
        epochs = json.loads(source.read_text())["epochs"]
        for number, epoch in enumerate(epochs):
            first = epoch["modes"][0] if epoch["modes"] else None
            yield _features(number, 0.5 * (epoch["start_s"] + epoch["end_s"]), first)
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise click.UsageError(
            f"{source} is not what `slowtime identify --window-s` writes: {error!r}."
        ) from error


def _of_text(source: Path) -> Iterator[Features]:
    with source.open(newline="") as file:
        table = csv.DictReader(file)
        missing = {"slow_time", "frequency_hz", "frequency_sd"} - set(table.fieldnames or ())
        if missing:
            raise click.UsageError(
                f"{source} lacks the columns {', '.join(sorted(missing))}. Give a header line."
            )
        for number, row in enumerate(table):
            try:
                yield _of_row(number, row)
            except (TypeError, ValueError) as error:
                raise click.UsageError(f"{source}, line {table.line_num}: {error}") from error


def _of_row(number: int, row: dict[str, str]) -> Features:
    damping, sd = row.get("damping_ratio"), row.get("damping_sd")
    mode = {
        "frequency_hz": {"value": float(row["frequency_hz"]), "sd": float(row["frequency_sd"])},
        "damping_ratio": {"value": float(damping or 0.0), "sd": float(sd or 0.0)},
        "correlation": 0.0,
        "flags": (),
    }
    return _features(number, float(row["slow_time"]), mode)


def _features(number: int, slow_time: float, mode: dict[str, Any] | None) -> Features:
    """Put an epoch as the edge would have told it; its sensor time only keeps the order."""
    modes = (
        ()
        if mode is None
        else (
            Mode(
                frequency_hz=Quantity(**mode["frequency_hz"]),
                damping_ratio=Quantity(**mode["damping_ratio"]),
                correlation=mode["correlation"],
                flags=tuple(mode["flags"]),
            ),
        )
    )
    t_ns = 946_684_800_000_000_000 + number * 10**9
    return Features(
        site=SITE,
        asset=ASSET,
        boot="offline",
        sequence=number,
        t_ns=t_ns,
        start_ns=t_ns,
        time_base="recorded",
        slow_time=slow_time,
        method="peak" if mode else "none",
        modes=modes,
        quality=Quality(samples=0),
    )


def _show(states: list[dict[str, Any]], changes: str) -> None:
    wanted = [f"{name}_change" for name in ("stiffness", "mass") if changes in (name, "both")]
    table = Table()
    for name in (
        "slow time",
        "frequency [Hz]",
        *(w.replace("_", " ") + " [%]" for w in wanted),
        "valid",
    ):
        table.add_column(name, justify="right", overflow="fold")
    every = max(1, len(states) // 40)
    for state in states[::every]:
        table.add_row(
            f"{state['slow_time']:g}",
            _cell(state["frequency_hz"], 1, 4),
            *(_cell(state[name], 100, 2) for name in wanted),
            "yes" if state["valid"] else "no",
        )
    Console().print(table)
    if every > 1:
        click.echo(f"every {every}th of {len(states)} epochs; --out writes all of them")
    reasons: dict[str, int] = {}
    for state in states:
        for reason in state["reasons"]:
            reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in sorted(reasons.items(), key=lambda item: -item[1]):
        click.echo(f"not valid in {count} of {len(states)}: {reason}")


def _cell(estimate: dict[str, float] | None, factor: float, digits: int) -> str:
    if estimate is None:
        return "-"
    value, sd = factor * estimate["value"], factor * estimate["sd"]
    return f"{value:.{digits}f} ± {sd:.{digits}f}"
