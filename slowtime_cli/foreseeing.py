"""The verbs `forecast` and `whatif`: where a twin is heading, and what it would do today."""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import click

from slowtime_services.client import AnswerError, Client, UnreachableError
from slowtime_services.files import ALL
from twin_server.orders import SimulationOrder
from twin_server.pipeline import AssetEvents, TwinKnowledge
from twin_server.registration.twin import Registration, registrations
from twin_server.serve import ProblemError, foretell

from .eventing import orders_of
from .evolving import Changes, registration_of, samples_of
from .offline import offline_twin
from .options import STDOUT
from .reading import Given, read_any, tell_reading
from .terminal import note, show, write_json

Side = Literal["below", "above"]


class Asked(NamedTuple):
    """A twin to be asked: a running server's, or one made here of a file."""

    source: Path | None
    server: str | None
    asset: str | None
    registration: Path | None
    events: Path | None
    changes: Changes
    nominal_hz: float | None
    nominal_damping: float | None
    learn_epochs: int


def forecast(
    horizon: float | None,
    points: int,
    threshold: float | None,
    quantity: str | None,
    toward: Side | None,
    out: Path | None,
    **twin: Any,
) -> None:
    """Tell where a twin is heading, and when a threshold is reached."""
    asked = Asked(**twin)
    more = {"threshold": threshold, "quantity": quantity, "toward": toward}
    if asked.server is not None:
        query = {"horizon": horizon, "points": points, **more}
        body = of_server(asked, "GET", "forecast", query=query)
    else:
        with made(asked) as (knowledge, twin_id, registration), said():
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
    for warning in body.get("warnings", ()):
        note(warning)
    for crossing in body["crossings"] if out != STDOUT else ():
        note(crossing["sentence"])
        if laws := _laws(crossing.get("laws", {})):
            note(f"degradation laws by evidence: {laws}.")


def whatif(
    kind: str,
    record: Path | None,
    channel: str | None,
    outputs: tuple[str, ...],
    out: Path | None,
    **options: Any,
) -> None:
    """Run today's twin under a load, with bands."""
    asked = Asked(**{name: options.pop(name) for name in Asked._fields})
    of_load = ("amplitude", "frequency_hz", "phase_deg", "at_s", "psd")
    given = {name: options.pop(name) for name in of_load}
    load: dict[str, Any] = {"kind": kind} | _without_none(given)
    if kind == "recorded":
        load["samples"], options["rate_hz"] = _recorded(record, channel, options["rate_hz"])
    more = {"outputs": list(outputs)} if outputs else {}
    order = SimulationOrder.model_validate({"load": load, **_without_none(options), **more})
    if asked.server is not None:
        body = of_server(
            asked, "POST", "simulate", body=order.model_dump(mode="json", exclude_none=True)
        )
    else:
        with made(asked) as (knowledge, twin_id, _), said():
            body = json.loads(knowledge.simulate(twin_id, order))
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show_response(body)
    for reason in body["reasons"]:
        note(reason)
    if body["assumed"]:
        note(f"taken for granted: {', '.join(body['assumed'])}.")


def _laws(weights: dict[str, float]) -> str:
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in weights.items())


def _without_none(given: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in given.items() if value is not None}


def _recorded(
    path: Path | None, channel: str | None, rate_hz: float | None
) -> tuple[list[float], float]:
    assert path is not None
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
def made(asked: Asked) -> Iterator[tuple[TwinKnowledge, str, Registration]]:
    """Make a twin of a file, and let it be asked."""
    assert asked.source is not None
    twin_id, samples = samples_of(asked.source, asked.asset)
    registration = _registration(asked, twin_id)
    with offline_twin() as (pipeline, store):
        pipeline.register(twin_id, registration)
        pipeline.ingest(samples)
        pipeline.give_up()
        if not len(store.history(twin_id, limit=1).states):
            raise click.UsageError(f"{asked.source} holds no epoch. Give one with some.")
        if asked.events is not None:
            keeping = AssetEvents(pipeline, store)
            with said():
                for order in orders_of(asked.events):
                    keeping.record(twin_id, registration, order, order.person or "offline")
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
def said() -> Iterator[None]:
    """Say what a twin says of a question that cannot be answered."""
    try:
        yield
    except ProblemError as error:
        raise click.UsageError(error.detail) from error


def of_server(
    asked: Asked,
    method: str,
    what: str,
    *,
    query: dict[str, Any] | None = None,
    body: object = None,
) -> dict[str, Any]:
    """Ask a running twin server."""
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
