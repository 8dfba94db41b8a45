"""The verb `whatif`: simulates the response of a twin to a load."""

import json
import sys
from pathlib import Path
from typing import Any, cast

import click

from slowtime_cli.shared.options import STDOUT
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_cli.twins.twin_query import TwinQuery, ask_server, without_none


def whatif(
    kind: str,
    record: Path | None,
    channel: str | None,
    outputs: tuple[str, ...],
    out: Path | None,
    **options: Any,
) -> None:
    """Simulate a twin's current structure under a load, with bands."""
    asked = TwinQuery(**{name: options.pop(name) for name in TwinQuery._fields})
    of_load = ("amplitude", "frequency_hz", "phase_deg", "at_s", "psd")
    given = {name: options.pop(name) for name in of_load}
    load: dict[str, Any] = {"kind": kind} | without_none(given)
    if kind == "recorded":
        load["samples"], options["rate_hz"] = _recorded(record, channel, options["rate_hz"])
    more = {"outputs": list(outputs)} if outputs else {}
    order = {"load": load, **without_none(options), **more}
    if asked.server is not None:
        body = ask_server(asked, "POST", "simulate", body=order)
    else:
        from twin_server.orders import SimulationOrder

        from .file_twin import problems_told, twin_of_file

        checked = SimulationOrder.model_validate(order)
        with twin_of_file(asked) as (knowledge, twin_id, _), problems_told():
            body = json.loads(knowledge.simulate(twin_id, checked))
    if out is not None:
        write_json(out, body)
    if out != STDOUT:
        _show_response(body)
    for reason in body["reasons"]:
        note(reason)
    if body["assumed"]:
        note(f"assumed: {', '.join(body['assumed'])}.")


def _recorded(
    path: Path | None, channel: str | None, rate_hz: float | None
) -> tuple[list[float], float]:
    # Readers of files bring NumPy and compilers; a load in numbers needs none of them.
    from slowtime_cli.shared.record_input import note_reading, read_any
    from slowtime_services.files import ALL, ReadingOptions

    assert path is not None
    record = read_any(path, ReadingOptions(rate_hz=rate_hz, keep=(ALL,)))
    note_reading(record)
    if record.gaps:
        raise click.UsageError(f"{path.name} lacks samples. Cut it at its gaps.")
    names = record.channels
    if channel is None and len(names) != 1:
        raise click.UsageError(
            f"{path.name} has {', '.join(names)}. Name one with --setting channel=NAME."
        )
    if channel is not None and channel not in names:
        raise click.UsageError(
            f"{path.name} has no {channel}, but: {', '.join(names)}. Name one with --setting "
            "channel=NAME."
        )
    column = names.index(channel) if channel is not None else 0
    samples = record.samples[:, column].astype(float).tolist()
    return cast(list[float], samples), record.rate_hz


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
