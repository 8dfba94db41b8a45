"""The verb `evolve`: estimates changes of stiffness and mass from frequencies."""

import collections
import json
import sys
from pathlib import Path
from typing import Any

import click

from slowtime_api.twin_files import ASSET, SITE, Changes, registration_of, samples_of
from slowtime_cli.shared.offline_twin import offline_twin
from slowtime_cli.shared.options import STDOUT
from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_schemas.slow_times import unit_in_words
from slowtime_services.reports.kinds.state import Reference, write_state_report
from twin_server.history.rendering import points, state_objects

MAX_ROWS = 40
"""Epochs that a terminal shows at most [1]."""


def evolve(
    source: Path,
    changes: Changes,
    nominal_hz: float | None,
    nominal_damping: float | None,
    learn_epochs: int,
    asset: str | None,
    out: Path | None,
    report: Path | None,
) -> None:
    """Estimate changes of stiffness and mass from frequencies."""
    registration = registration_of(changes, nominal_hz, nominal_damping, learn_epochs)
    twin_id, samples = samples_of(source, asset, note)
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
        raise click.UsageError(f"{source} holds no epoch. Give a source with at least one.")
    if out != STDOUT:
        _show(states, changes)
    if out is not None:
        write_json(out, {"points": states})
    if report is not None:
        own = "" if twin_id == f"{SITE}.{ASSET}" else twin_id
        write_state_report(
            report, source.name, states, changes, structure=report_subject() or own,
            reference=Reference(nominal_hz, 0 if nominal_hz else learn_epochs),
            language=report_language(),
        )  # fmt: skip


def _show(states: list[dict[str, Any]], changes: str) -> None:
    wanted = [f"{name}_change" for name in ("stiffness", "mass") if changes in (name, "both")]
    heads = [w.replace("_", " ") + " [%]" for w in wanted]
    every = max(1, len(states) // MAX_ROWS) if sys.stdout.isatty() else 1
    shown = states[::every]
    rows = [
        (
            f"{state['slow_time']:g}",
            _cell(state["frequency_hz"], 1, 4),
            *(_cell(state[name], 100, 2) for name in wanted),
            "yes" if state["valid"] else "no",
        )
        for state in shown
    ]
    plain = [_fields_of_state(state, wanted) for state in shown]
    unit = unit_in_words(states[0]["slow_time_unit"]) if states else ""
    show("", (f"slow time [{unit}]", "frequency [Hz]", *heads, "valid"), rows, plain=plain)
    if every > 1:
        note(f"every {every}th of {len(states)} epochs is shown; --out writes all of them.")
    reasons = collections.Counter(reason for state in states for reason in state["reasons"])
    for reason, count in reasons.most_common():
        note(f"not valid in {count} of {len(states)}: {reason}")


def _fields_of_state(state: dict[str, Any], wanted: list[str]) -> dict[str, Any]:
    """Spread the estimates of a state over the fields of a line."""
    fields: dict[str, Any] = {"slow_time": state["slow_time"]}
    for name in ("frequency_hz", *wanted):
        estimate = state[name] or {}
        short = name.removesuffix("_hz")
        fields[name] = estimate.get("value")
        for part in ("sd", "lo", "hi"):
            fields[f"{short}_{part}"] = estimate.get(part)
    return fields | {"valid": state["valid"], "reasons": "; ".join(state["reasons"])}


def _cell(estimate: dict[str, float] | None, factor: float, digits: int) -> str:
    if estimate is None:
        return "-"
    value, sd = factor * estimate["value"], factor * estimate["sd"]
    return f"{value:.{digits}f} ± {sd:.{digits}f}"
